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
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.errors import StoreError
from sfkit.evaluation.metrics import ImageErrors

APPLICATION_ID = 0x73666B74  # "sfkt", in the file's header: tells a store from any other SQLite file
SCHEMA_VERSION = 1
NETWORK_FILE_SYSTEMS = frozenset(
    [
        "nfs",
        "nfs4",
        "cifs",
        "smb",
        "smb2",
        "smb3",
        "smbfs",
        "ncpfs",
        "afs",
        "9p",
        "ceph",
        "lustre",
        "gpfs",
        "beegfs",
        "glusterfs",
        "pvfs2",
        "davfs",
        "fuse.sshfs",
        "fuse.glusterfs",
        "fuse.s3fs",
        "fuse.gcsfuse",
        "fuse.rclone",
        "fuse.ceph",
    ]
)

_SCHEMA = """
CREATE TABLE IF NOT EXISTS evaluations (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT NOT NULL UNIQUE,
    description TEXT NOT NULL,
    errors TEXT,
    failure TEXT,
    seconds REAL NOT NULL,
    written REAL NOT NULL,
    attempts INTEGER NOT NULL DEFAULT 1
)
"""
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
        row = self._rows(
            "SELECT key, description, errors, failure, seconds FROM evaluations WHERE key = ?", (key,)
        )
        return _evaluation(row[0]) if row else None

    def put(self, evaluation: Evaluation) -> Evaluation:
        """Write an evaluation and return what the store now holds under its key: the first one written.

        A recorded failure is replaced by a later attempt, which only happens on request.
        """
        errors = None if evaluation.failure else json.dumps([image.to_dict() for image in evaluation.images])
        with self._lock, self._db:
            self._db.execute(
                "INSERT INTO evaluations (key, description, errors, failure, seconds, written) "
                "VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET errors = excluded.errors, "
                "failure = excluded.failure, seconds = excluded.seconds, written = excluded.written, "
                "attempts = attempts + 1 WHERE evaluations.failure IS NOT NULL",
                (
                    evaluation.key,
                    json.dumps(evaluation.description, sort_keys=True),
                    errors,
                    evaluation.failure,
                    evaluation.seconds,
                    time.time(),
                ),
            )
        held = self.get(evaluation.key)
        if held is None:
            raise StoreError(f"{self.path}: the evaluation just written cannot be read back, check the disk")
        return held

    def __iter__(self) -> Iterator[Evaluation]:
        """All evaluations in the order they were first written."""
        query = "SELECT key, description, errors, failure, seconds FROM evaluations ORDER BY number"
        return (_evaluation(row) for row in self._rows(query, ()))

    def attempts(self, key: str) -> int:
        """How often the evaluation under ``key`` was computed and offered; 0 where there is none."""
        row = self._rows("SELECT attempts FROM evaluations WHERE key = ?", (key,))
        return int(row[0][0]) if row else 0

    def mark(self, key: str, mark: str, detail: str = "") -> None:
        """Note something about an evaluation that is no part of its scores; a second time changes nothing."""
        with self._lock, self._db:
            self._db.execute("INSERT OR IGNORE INTO marks VALUES (?, ?, ?)", (key, mark, detail))

    def marks(self, mark: str) -> tuple[tuple[str, str], ...]:
        """(key, detail) of all evaluations with this mark, in the order they were marked."""
        rows = self._rows("SELECT key, detail FROM marks WHERE mark = ? ORDER BY rowid", (mark,))
        return tuple((str(key), str(detail)) for key, detail in rows)

    def _rows(self, query: str, values: Iterable[Any]) -> list[Any]:
        with self._lock, closing(self._db.execute(query, tuple(values))) as cursor:
            return cursor.fetchall()


def _evaluation(row: Sequence[Any]) -> Evaluation:
    key, description, errors, failure, seconds = row
    images = tuple(ImageErrors.from_dict(image) for image in json.loads(errors)) if errors else ()
    return Evaluation(key, json.loads(description), images, failure, seconds, cached=True)


def _open(path: Path) -> sqlite3.Connection:
    new = not path.exists() or path.stat().st_size == 0
    db = None
    try:
        db = sqlite3.connect(path, timeout=60.0, check_same_thread=False)
        if not new and str(path) != ":memory:":
            _check_identity(db, path)
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        with db:
            db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            db.execute(_SCHEMA)
            db.execute(_MARKS_SCHEMA)
    except sqlite3.DatabaseError as error:
        if db is not None:
            db.close()
        raise StoreError(
            f"{path}: cannot be used as an evaluation store ({error}): it is left as it is; "
            "restore it from a copy or name another file"
        ) from error
    except StoreError:
        if db is not None:
            db.close()
        raise
    return db


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


def file_system(path: Path, mounts: Path = Path("/proc/mounts")) -> str:
    """The file-system type ``path`` lies on, by the mount table; empty where there is none to read."""
    if not mounts.is_file():
        return ""
    place = path.absolute()
    best, kind = -1, ""
    for line in mounts.read_text(encoding="utf-8", errors="replace").splitlines():
        _, point, fstype, *_ = line.split(" ")
        target = Path(point.replace("\\040", " "))
        if place.is_relative_to(target) and len(target.parts) >= best:
            best, kind = len(target.parts), fstype
    return kind
