"""The evaluation store: one SQLite file that holds every evaluation, and is the only state a search has.

The first score written under a key is the truth; a second one for the same key is dropped. A score is
on disk before anyone hears of it, so that a search killed at any moment and started again from its
seed fast-forwards through the store and ends where it would have ended.
"""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.errors import StoreError
from sfkit.evaluation.file_systems import NETWORK_FILE_SYSTEMS, file_system
from sfkit.evaluation.metrics import ImageErrors

APPLICATION_ID = 0x73666B74  # "sfkt", in the file's header: tells a store from any other SQLite file
HAND_EDIT = "hand edit"  # the mark of an evaluation that a person asked for
SCHEMA_VERSION = 1
OPEN_SECONDS = 60.0  # how long a process waits for another that holds the file
_DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)  # the latter where garbage stands in SQLite's message
_BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_SCHEMA = """
CREATE TABLE IF NOT EXISTS evaluations (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT NOT NULL UNIQUE,
    description TEXT NOT NULL,
    errors TEXT,
    failure TEXT,
    seconds REAL NOT NULL,
    written REAL NOT NULL,
    attempts INTEGER NOT NULL DEFAULT 1,
    checksum TEXT
)
"""
_COLUMNS = "key, description, errors, failure, seconds, checksum"
_MARKS_SCHEMA = """
CREATE TABLE IF NOT EXISTS marks (
    key TEXT NOT NULL,
    mark TEXT NOT NULL,
    detail TEXT NOT NULL,
    UNIQUE (key, mark)
)
"""


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
    """

    key: str
    description: Mapping[str, Any]
    images: tuple[ImageErrors, ...]
    failure: str | None
    seconds: float
    cached: bool = False


def evaluation_key(description: Mapping[str, Any]) -> str:
    """The key of an evaluation: a digest of its description as canonical JSON."""
    return text_digest(json.dumps(description, sort_keys=True, separators=(",", ":"), allow_nan=False))


class EvaluationStore:
    """Evaluations by key in one SQLite file (WAL), shared safely by threads and processes.

    Args:
        path: the file; made if it does not exist (with its folder). ``:memory:`` keeps nothing.

    Raises:
        StoreError: the file is damaged, no store, written by a newer sfkit, or on a network file system.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._lock = threading.RLock()
        if str(path) != ":memory:":
            _refuse_network(self.path)
            if self.path.is_dir():
                raise StoreError(
                    f"{self.path}: is a folder, expected an evaluation store or a new file's name"
                )
            self.path.parent.mkdir(parents=True, exist_ok=True)
        self._db = _open(self.path)

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
        row = self._rows(f"SELECT {_COLUMNS} FROM evaluations WHERE key = ?", (key,))
        return self._evaluation(row[0]) if row else None

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
        with self._writing():
            cursor = self._db.execute(
                "INSERT INTO evaluations (key, description, errors, failure, seconds, checksum, written) "
                "VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET errors = excluded.errors, "
                "failure = excluded.failure, seconds = excluded.seconds, checksum = excluded.checksum, "
                "written = excluded.written, attempts = attempts + 1 WHERE evaluations.failure IS NOT NULL",
                (*row, _checksum(*row), time.time()),
            )
        if cursor.rowcount == 1:
            return replace(evaluation, cached=True)
        held = self.get(evaluation.key)
        if held is None:
            raise StoreError(f"{self.path}: the evaluation just written cannot be read back, check the disk")
        return held

    def __iter__(self) -> Iterator[Evaluation]:
        """All evaluations in the order they were first written."""
        query = f"SELECT {_COLUMNS} FROM evaluations ORDER BY number"
        return (self._evaluation(row) for row in self._rows(query, ()))

    @property
    def last(self) -> int:
        """The number of the evaluation written last; 0 where there is none."""
        return int(self._rows("SELECT COALESCE(MAX(number), 0) FROM evaluations", ())[0][0])

    def until(self, number: int) -> Iterator[Evaluation]:
        """The evaluations first written up to a number that :attr:`last` gave, in that order."""
        query = f"SELECT {_COLUMNS} FROM evaluations WHERE number <= ? ORDER BY number"
        return (self._evaluation(row) for row in self._rows(query, (number,)))

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

    def _evaluation(self, row: Sequence[Any]) -> Evaluation:
        key, description, errors, failure, seconds, checksum = row
        if checksum not in (None, _checksum(*row[:5])):
            raise StoreError(
                f"{self.path}: is damaged, evaluation {key} is not what was written: it is left as it is; "
                "restore it from a copy or name another file"
            )
        images = tuple(ImageErrors.from_dict(image) for image in json.loads(errors)) if errors else ()
        return Evaluation(key, json.loads(description), images, failure, seconds, cached=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """One transaction: all of it is on disk afterwards, or nothing where it raises."""
        with self._lock, self._as_store_errors(), self._db:
            yield

    @contextmanager
    def _as_store_errors(self) -> Iterator[None]:
        """SQLite's errors as a sentence; a closed store is the caller's mistake and stays as it is."""
        try:
            yield
        except sqlite3.ProgrammingError:
            raise
        except _DAMAGE as error:
            raise StoreError(f"{self.path}: {_remedy(error)}") from error


def _checksum(*row: str | float | None) -> str:
    """Tells garbage from what was written: SQLite checks how its pages hang together, not what they say."""
    return text_digest(json.dumps(row))


def _open(path: Path) -> sqlite3.Connection:
    """Open a store, or make it; the file of one that is there is not touched."""
    new = not path.exists() or path.stat().st_size == 0
    db = None
    try:
        db = sqlite3.connect(path, timeout=OPEN_SECONDS, check_same_thread=False)
        if not new and str(path) != ":memory:":
            _check_identity(db, path)
        if not _complete(db):
            _make(db)
        db.execute("PRAGMA synchronous = FULL")
    except _DAMAGE as error:
        if db is not None:
            db.close()
        raise StoreError(f"{path}: {_remedy(error)}") from error
    except StoreError:
        if db is not None:
            db.close()
        raise
    return db


def _complete(db: sqlite3.Connection) -> bool:
    """True where everything :func:`_make` makes is there."""
    (mode,) = db.execute("PRAGMA journal_mode").fetchone()
    (marks,) = db.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'marks'").fetchone()
    return mode == "wal" and bool(marks) and "checksum" in _columns(db)


def _columns(db: sqlite3.Connection) -> list[str]:
    return [row[1] for row in db.execute("PRAGMA table_info(evaluations)")]


def _make(db: sqlite3.Connection) -> None:
    """Make the tables; two processes may do so at once, and one that is killed leaves all or nothing."""
    _use_wal(db)
    db.execute("BEGIN IMMEDIATE")
    with db:
        db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        db.execute(_SCHEMA)
        db.execute(_MARKS_SCHEMA)
        if "checksum" not in _columns(db):  # stores from before there were any go on without
            db.execute("ALTER TABLE evaluations ADD COLUMN checksum TEXT")


def _use_wal(db: sqlite3.Connection) -> None:
    """Turn the journal mode; SQLite does not wait for another process that is just doing the same."""
    deadline = time.monotonic() + OPEN_SECONDS
    while True:
        try:
            db.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode not in _BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return


def _remedy(error: Exception) -> str:
    """What went wrong and what to do, the end of a sentence that begins with the file."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    if code == sqlite3.SQLITE_FULL or code & 0xFF == sqlite3.SQLITE_IOERR:
        return (
            f"cannot be read or written ({error}): what was stored before is kept; look whether the disk is "
            "full or failing, make room and start again"
        )
    if code & 0xFF in _BUSY:
        return f"another process has held it for a minute ({error}): end that one, then start again"
    return (
        f"cannot be used as an evaluation store ({error}): it is left as it is; restore it from a copy or "
        "name another file"
    )


def _check_identity(db: sqlite3.Connection, path: Path) -> None:
    identity = db.execute("PRAGMA application_id").fetchone()[0]
    version = db.execute("PRAGMA user_version").fetchone()[0]
    tables = db.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0]
    if identity != APPLICATION_ID and tables:
        raise StoreError(f"{path}: is an SQLite file but no evaluation store, name another file")
    if version > SCHEMA_VERSION:
        raise StoreError(
            f"{path}: was written by a newer sfkit (store version {version}), update sfkit to read it"
        )
    problem = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if problem != "ok":
        raise StoreError(f"{path}: is damaged ({problem}): it is left as it is; restore it from a copy")


def _refuse_network(path: Path) -> None:
    """WAL needs shared memory, which network file systems do not give: two machines would corrupt it."""
    kind = file_system(path)
    if kind in NETWORK_FILE_SYSTEMS:
        raise StoreError(
            f"{path}: lies on a network file system ({kind}), where SQLite can lose data: put the store on a "
            "local disk and copy the file when the search is done"
        )
