"""The file of an evaluation store: made whole or not at all, opened as its place allows, rescued if lost."""

from __future__ import annotations

import errno
import os
import sqlite3
import time
import warnings
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from sfkit.errors import DamagedStoreError, SfkitWarning, StoreError
from sfkit.evaluation.file_systems import file_system, is_shared
from sfkit.files import fresh_beside, writing

APPLICATION_ID = 0x73666B74  # "sfkt", in the file's header: tells a store from any other SQLite file
SCHEMA_VERSION = 2  # 1 had no CPU seconds, and takes a checksum over them for damage
OPEN_SECONDS = 60.0  # how long a process waits for another that holds the file
DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)  # the latter where garbage stands in SQLite's message
MEMORY = ":memory:"
_BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_NO_ACCESS = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM)
_NO_LINKS = (errno.EPERM, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK)
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
    checksum TEXT,
    cpu_seconds REAL
)
"""
_ADDED = {"checksum": "TEXT", "cpu_seconds": "REAL"}
"""Columns that stores of earlier versions lack."""
_MARKS_SCHEMA = """
CREATE TABLE IF NOT EXISTS marks (
    key TEXT NOT NULL,
    mark TEXT NOT NULL,
    detail TEXT NOT NULL,
    UNIQUE (key, mark)
)
"""


def companions(path: Path) -> tuple[Path, ...]:
    """The files that SQLite keeps beside a store while it is open."""
    return tuple(path.with_name(path.name + ending) for ending in ("-wal", "-shm", "-journal"))


def open_store(path: Path, *, read_only: bool = False) -> sqlite3.Connection:
    """Open a store, or make it; the file of one that is there is not touched.

    A store on a file system that other machines may write to keeps a rollback journal: SQLite's write-ahead
    log needs memory that all its users share, which they have not.

    Args:
        path: the file, or ``:memory:``.
        read_only: whether one that cannot be written to is opened for reading; one of an earlier version is
            left as it is then.

    Raises:
        StoreError: the file is damaged, no store, empty, or written by a newer sfkit; or it cannot be made.
    """
    if str(path) == MEMORY:
        return _opened(path, "memory")
    if path.is_dir():
        raise StoreError(f"{path}: is a folder, expected an evaluation store or a new file's name")
    kind = file_system(path)
    # A write-ahead log goes by shared memory, which two machines have none of.
    mode = "delete" if is_shared(kind) else "wal"
    if mode == "delete":
        warnings.warn(
            f"{path}: lies on a file system that other machines share ({kind}): let one machine at a time "
            "write to this store, or keep it on a local disk",
            SfkitWarning,
            stacklevel=3,
        )
    try:
        if not path.exists():
            _create(Path(os.path.realpath(path)), lambda db: _make(db, mode))
        elif path.stat().st_size == 0:
            raise StoreError(
                f"{path}: is empty, expected an evaluation store or a new file's name: name another"
            )
        return _opened(path, mode, read_only=read_only)
    except DAMAGE as error:
        code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
        if read_only and code in _NO_ACCESS and os.access(path, os.R_OK):
            return _immutable(path)
        raise broken(path, error) from error
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be opened ({error.strerror}), expected a place to write to"
        ) from error


def restore(db: sqlite3.Connection, path: Path) -> None:
    """Write a store that was deleted while it was open to its place again, and close it.

    Raises:
        StoreError: that cannot be done; the connection stays open.
    """
    place = Path(os.path.realpath(path))
    try:
        with writing(place) as fresh:
            with closing(sqlite3.connect(fresh)) as copy:
                db.backup(copy)
            db.close()
            for left in companions(place):  # of the deleted file: SQLite would take them for the new one's
                left.unlink(missing_ok=True)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(
            f"{path}: was deleted while in use, and cannot be written again ({error})"
        ) from error


def remedy(error: Exception) -> str:
    """What went wrong and what to do, the end of a sentence that begins with the file."""
    # Errors that Python itself raises carry no code of SQLite's.
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    if code == sqlite3.SQLITE_FULL or code & 0xFF == sqlite3.SQLITE_IOERR:
        return (
            f"cannot be read or written ({error}): what was stored before is kept; look whether the disk is "
            "full or failing, make room and start again"
        )
    if code & 0xFF in _BUSY:
        return f"another process has held it for a minute ({error}): end that one, then start again"
    if code & 0xFF in _NO_ACCESS:
        return f"may not be written to ({error}): make file and folder writable, or work on a copy elsewhere"
    return (
        f"cannot be used as an evaluation store ({error}): it is left as it is; restore it from a copy or "
        "name another file"
    )


def broken(path: Path, error: Exception) -> StoreError:
    """SQLite's error as a sentence."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    if code == sqlite3.SQLITE_CORRUPT or isinstance(error, UnicodeDecodeError):
        return DamagedStoreError(f"{path}: is damaged ({error}): {salvage(path)}")
    return StoreError(f"{path}: {remedy(error)}")


def salvage(path: Path) -> str:
    """What to do with a damaged store, the end of a sentence."""
    return (
        "it is left as it is; restore it from a copy, or keep what can be read of it in another: sfkit runs "
        f"import {path} --into NEW"
    )


def _opened(path: Path, mode: str, *, read_only: bool = False) -> sqlite3.Connection:
    db = sqlite3.connect(path, timeout=OPEN_SECONDS, check_same_thread=False)
    try:
        if mode == "delete":  # held alone, a log can be turned without shared memory
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
        if str(path) != MEMORY:
            _check_identity(db, path)
        if not _complete(db, mode):
            # Columns are added by who writes: a reader would lock out those who run an earlier version.
            served = _complete(db, mode, columns=False)
            if not (read_only and served):
                _complete_or_leave(db, mode, served=served)
        if mode == "delete":
            db.execute("PRAGMA locking_mode = NORMAL")
            db.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()  # lets go of it
        # NORMAL may lose the last writes to a power cut, and a score is on disk before anyone is told of it.
        db.execute("PRAGMA synchronous = FULL")
    except BaseException:
        db.close()
        raise
    return db


def _immutable(path: Path) -> sqlite3.Connection:
    """A store that nobody here can write to, as it lies there."""
    try:
        # Locks need a file beside it, for which a folder without write access has no place.
        db = sqlite3.connect(
            f"file:{quote(str(path.absolute()))}?immutable=1", uri=True, check_same_thread=False
        )
        _check_identity(db, path)
    except DAMAGE as error:
        raise broken(path, error) from error
    return db


def _create(path: Path, fill: Callable[[sqlite3.Connection], None]) -> None:
    """Make a new file by filling it elsewhere; where two processes do, one of them is first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with fresh_beside(path) as fresh:
        with closing(sqlite3.connect(fresh)) as db:
            fill(db)
        try:
            # A link, since renaming would replace the file of a process that was first.
            os.link(fresh, path)
        except FileExistsError:
            return
        except OSError as error:
            if error.errno not in _NO_LINKS:
                raise
            # Without links who was first is looked for, and no longer certain.
            if not path.exists():
                fresh.rename(path)


def _complete_or_leave(db: sqlite3.Connection, mode: str, *, served: bool) -> None:
    """Make what is missing; one that may not be written to is left as it is where it can be ``served``."""
    try:
        _make(db, mode)
    except sqlite3.Error as error:
        if not served or getattr(error, "sqlite_errorcode", 0) & 0xFF not in _NO_ACCESS:
            raise


def _complete(db: sqlite3.Connection, mode: str, *, columns: bool = True) -> bool:
    """True where everything :func:`_make` makes is there; without ``columns`` added ones may be missing."""
    (found,) = db.execute("PRAGMA journal_mode").fetchone()
    (marks,) = db.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'marks'").fetchone()
    return found == mode and bool(marks) and (not columns or set(_ADDED) <= set(_columns(db)))


def readable_columns(db: sqlite3.Connection, wanted: str) -> str:
    """The columns of evaluations for SELECT; NULL stands for one that a store of an earlier version lacks."""
    there = _columns(db)
    names = wanted.split(", ")
    return ", ".join(n if n in there or n not in _ADDED else f"NULL AS {n}" for n in names)


def _columns(db: sqlite3.Connection) -> list[str]:
    return [row[1] for row in db.execute("PRAGMA table_info(evaluations)")]


def _make(db: sqlite3.Connection, mode: str) -> None:
    """Make the tables; two processes may do so at once, and one that is killed leaves all or nothing."""
    if mode != "memory":
        _turn_journal(db, mode)
    # Two that read first and write later would refuse each other at once, without waiting.
    db.execute("BEGIN IMMEDIATE")
    with db:
        db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        db.execute(_SCHEMA)
        db.execute(_MARKS_SCHEMA)
        for column in _ADDED.keys() - _columns(db):  # the rows of earlier stores go on without
            db.execute(f"ALTER TABLE evaluations ADD COLUMN {column} {_ADDED[column]}")


def _turn_journal(db: sqlite3.Connection, mode: str) -> None:
    """Turn the journal mode; SQLite does not wait for another process that is just doing the same."""
    deadline = time.monotonic() + OPEN_SECONDS
    while True:
        try:
            db.execute(f"PRAGMA journal_mode = {mode}")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode not in _BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return


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
    # Linear in the size of the file, where integrity_check compares every index as well.
    problem = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if problem != "ok":
        problem = problem.rpartition("\n")[2]  # after the name of the database
        raise DamagedStoreError(f"{path}: is damaged ({problem}): {salvage(path)}")
