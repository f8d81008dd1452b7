"""The evaluation store: one SQLite file that holds every evaluation, and is the only state a search has.

The first score written under a key is the truth; a second one for the same key is dropped. A score is
on disk before anyone is told of it, so that a search killed at any moment and started again from its
seed fast-forwards through the store and ends where it would have ended.
"""

from __future__ import annotations

import json
import sqlite3
import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.errors import DamagedStoreError, SfkitWarning, StoreError
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.store_file import DAMAGE, MEMORY, broken, open_store, readable_columns, restore, salvage

HAND_EDIT = "hand edit"  # the mark of an evaluation that a person asked for
BASELINE = "baseline"  # the mark of one that a baseline asked for first
COLUMNS = "key, description, errors, failure, seconds, checksum, cpu_seconds"


@dataclass(frozen=True)
class Evaluation:
    """One recipe scored on one benchmark.

    Attributes:
        key: digest of ``description``.
        description: everything that decides the scores, in content rather than names.
        images: per-image sums and counts, in the benchmark's order; empty where the candidate failed.
        failure: why it failed, None where it did not.
        seconds: what it took to compute.
        cached: True where it came from the store.
        cpu_seconds: what it took of processors, its workers' included; None where nobody measured that, as in
            stores of earlier versions.
    """

    key: str
    description: Mapping[str, Any]
    images: tuple[ImageErrors, ...]
    failure: str | None
    seconds: float
    cached: bool = False
    cpu_seconds: float | None = None


def evaluation_key(description: Mapping[str, Any]) -> str:
    """The key of an evaluation: a digest of its description as canonical JSON."""
    return text_digest(json.dumps(description, sort_keys=True, separators=(",", ":"), allow_nan=False))


class EvaluationStore:
    """Evaluations by key in one SQLite file, shared safely by threads and processes.

    A file that is deleted while it is open is written again with the next evaluation.

    Args:
        path: the file; made if it does not exist (with its folder). ``:memory:`` keeps nothing.
        read_only: whether one that may not be written to is opened for reading.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where the file lies on a network file system.

    Raises:
        StoreError: the file is damaged, no store, empty, or written by a newer sfkit.
    """

    def __init__(self, path: str | Path, *, read_only: bool = False) -> None:
        self.path = Path(path)
        self._lock = threading.RLock()
        self._db = open_store(self.path, read_only=read_only)
        self._opened = self._identity()
        self._columns = readable_columns(self._db, COLUMNS)

    def __enter__(self) -> EvaluationStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        return int(self._rows("SELECT COUNT(*) FROM evaluations", ())[0][0])

    def close(self) -> None:
        """Close the file; nothing is pending, every write is already on disk."""
        with self._lock:
            self._db.close()

    def get(self, key: str) -> Evaluation | None:
        """The evaluation under ``key``, or None."""
        row = self._rows(f"SELECT {self._columns} FROM evaluations WHERE key = ?", (key,))
        return evaluation_of(row[0], self.path) if row else None

    def put(self, evaluation: Evaluation) -> Evaluation:
        """Write an evaluation and return what the store now holds under its key: the first one written.

        A recorded failure is replaced by a later attempt, which only happens on request.

        Raises:
            StoreError: the disk is full, or the file was damaged or taken away since it was opened. What
                was written before stays.
        """
        description = json.dumps(evaluation.description, sort_keys=True)
        errors = None if evaluation.failure else json.dumps([image.to_dict() for image in evaluation.images])
        row = (evaluation.key, description, errors, evaluation.failure, float(evaluation.seconds))
        worked = None if evaluation.cpu_seconds is None else float(evaluation.cpu_seconds)
        with self._writing():
            # One statement: a result takes a failure's place, and nothing takes a result's.
            cursor = self._db.execute(
                "INSERT INTO evaluations (key, description, errors, failure, seconds, checksum, cpu_seconds, "
                "written) VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET "
                "errors = excluded.errors, failure = excluded.failure, seconds = excluded.seconds, "
                "checksum = excluded.checksum, cpu_seconds = excluded.cpu_seconds, "
                "written = excluded.written, attempts = attempts + 1 WHERE evaluations.failure IS NOT NULL",
                (*row, _checksum(*row, worked), worked, time.time()),
            )
        if cursor.rowcount == 1:
            return replace(evaluation, cached=True)
        # No row was written: somebody else was first, and that score is the truth.
        held = self.get(evaluation.key)
        if held is None:
            raise StoreError(f"{self.path}: the evaluation just written cannot be read back, check the disk")
        return held

    def __iter__(self) -> Iterator[Evaluation]:
        """All evaluations in the order they were first written."""
        query = f"SELECT {self._columns} FROM evaluations ORDER BY number"
        return (evaluation_of(row, self.path) for row in self._rows(query, ()))

    @property
    def last(self) -> int:
        """The number of the evaluation written last; 0 where there is none."""
        return int(self._rows("SELECT COALESCE(MAX(number), 0) FROM evaluations", ())[0][0])

    def until(self, number: int) -> Iterator[Evaluation]:
        """The evaluations first written up to a number that :attr:`last` gave, in that order."""
        query = f"SELECT {self._columns} FROM evaluations WHERE number <= ? ORDER BY number"
        return (evaluation_of(row, self.path) for row in self._rows(query, (number,)))

    def attempts(self, key: str) -> int:
        """How often the evaluation under ``key`` was computed and offered; 0 where there is none."""
        row = self._rows("SELECT attempts FROM evaluations WHERE key = ?", (key,))
        return int(row[0][0]) if row else 0

    def mark(self, key: str, mark: str, detail: str = "") -> None:
        """Note something about an evaluation that is no part of its scores; a second time changes nothing."""
        with self._writing():
            self._db.execute("INSERT OR IGNORE INTO marks VALUES (?, ?, ?)", (key, mark, detail))

    def marks(self, mark: str) -> tuple[tuple[str, str], ...]:
        """(key, detail) of all evaluations with this mark, in the order they were marked."""
        rows = self._rows("SELECT key, detail FROM marks WHERE mark = ? ORDER BY rowid", (mark,))
        return tuple((str(key), str(detail)) for key, detail in rows)

    def _rows(self, query: str, values: Iterable[Any]) -> list[Any]:
        with self._lock, self._as_store_errors(), closing(self._db.execute(query, tuple(values))) as cursor:
            return cursor.fetchall()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """One transaction: all of it is on disk afterwards, or nothing where it raises."""
        with self._lock:
            self._ensure_there()
            with self._as_store_errors(), self._db:
                yield
            # Again: it may have been deleted while this was written.
            self._ensure_there()

    def _ensure_there(self) -> None:
        """Write the store again where its file was deleted: it is open here still, with all that it held.

        Raises:
            StoreError: another file took its place.
        """
        found = self._identity()
        if found == self._opened:
            return
        if found is not None:
            raise StoreError(
                f"{self.path}: another file took this store's place while it was in use: what was evaluated "
                "since is not in it; start again"
            )
        restore(self._db, self.path)
        self._db = open_store(self.path)
        self._opened = self._identity()
        warnings.warn(
            f"{self.path}: was deleted while in use, and is written again with all it held",
            SfkitWarning,
            stacklevel=2,
        )

    def _identity(self) -> tuple[int, int] | None:
        """Which file lies at the path; None where there is none."""
        if str(self.path) == MEMORY:
            return (0, 0)
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    @contextmanager
    def _as_store_errors(self) -> Iterator[None]:
        """SQLite's errors as a sentence; a closed store is the caller's mistake and stays as it is."""
        try:
            yield
        except sqlite3.ProgrammingError:
            raise
        except DAMAGE as error:
            raise broken(self.path, error) from error


def evaluation_of(row: Sequence[Any], path: Path) -> Evaluation:
    """The evaluation in a row of ``COLUMNS``.

    Raises:
        DamagedStoreError: it is not what was written.
    """
    key, description, errors, failure, seconds, checksum, worked = row
    # None in rows from before there were checksums. A process of an earlier version, which knows no CPU
    # seconds, leaves those of the failure that its result replaces.
    if checksum not in (None, _checksum(*row[:5], worked), _checksum(*row[:5], None)):
        raise DamagedStoreError(
            f"{path}: is damaged, evaluation {key} is not what was written: {salvage(path)}"
        )
    images = tuple(ImageErrors.from_dict(image) for image in json.loads(errors)) if errors else ()
    about = json.loads(description)
    return Evaluation(key, about, images, failure, seconds, cached=True, cpu_seconds=worked)


def _checksum(key: str, description: str, *rest: str | float | None) -> str:
    """Tells garbage from what was written: SQLite checks how its pages hang together, not what they say."""
    # Rows from before CPU seconds were measured have none, and the digest of what they have.
    row = (key, description, *(rest[:-1] if rest[-1] is None else rest))
    return text_digest(json.dumps(row))
