"""What can be read of a damaged store, row by row: a lost page takes its own rows along, no others."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from sfkit.errors import DamagedStoreError, SfkitError
from sfkit.evaluation.exchange import check_evaluation, take
from sfkit.evaluation.store import COLUMNS, Evaluation, EvaluationStore, evaluation_of
from sfkit.evaluation.store_file import APPLICATION_ID, DAMAGE, companions, readable_columns

_AT_APPLICATION_ID = slice(68, 72)  # in the header of an SQLite file


@dataclass(frozen=True)
class Rescued:
    """What became of a damaged store's evaluations.

    Attributes:
        copied: how many went into the other store.
        held: how many that one had.
        lost: the numbers, in the order of writing, of those that cannot be read.
    """

    copied: int
    held: int
    lost: tuple[int, ...]


def rescue(path: Path, target: EvaluationStore) -> Rescued:
    """Copy all evaluations that can be read of a damaged store into another; the damaged file is not touched.

    Every row is read by itself, and believed where its checksum, its key and its counts hold.

    Raises:
        DamagedStoreError: no table of evaluations can be found in it.
    """
    copied = held = 0
    lost = []
    with tempfile.TemporaryDirectory(prefix="sfkit-rescue-") as scratch:
        place = Path(scratch) / "store.sqlite"
        for file, name in zip((path, *companions(path)), (place, *companions(place)), strict=True):
            if file.exists():
                # A copy: opening the file itself would write its log into it.
                shutil.copyfile(file, name)
        for number, evaluation in _rows(path, place):
            if evaluation is None:
                lost.append(number)
            elif take(evaluation, target):
                copied += 1
            else:
                held += 1
    return Rescued(copied, held, tuple(lost))


def _rows(path: Path, place: Path) -> Iterator[tuple[int, Evaluation | None]]:
    """Number and evaluation of each row that there was; None where it cannot be read."""
    if place.read_bytes()[_AT_APPLICATION_ID] != APPLICATION_ID.to_bytes(4, "big"):
        raise DamagedStoreError(f"{path}: nothing of it can be read, restore it from a copy")
    with closing(sqlite3.connect(place)) as db:
        last = _last(db, path, place.stat().st_size)
        named, all_named = _named(db)
        columns = readable_columns(db, COLUMNS)
        # One by one: a scan of the table would end at the first page that is lost.
        for number in range(1, last + 1):
            there = number in named
            try:
                found = db.execute(
                    f"SELECT {columns} FROM evaluations WHERE number = ?", (number,)
                ).fetchone()
                evaluation = None if found is None else evaluation_of(found, path)
                if evaluation is not None:
                    check_evaluation(evaluation, str(path))
            except (*DAMAGE, SfkitError, ValueError, TypeError, KeyError, AttributeError):
                evaluation = None
                there = there or not all_named
            if there or evaluation is not None:  # a score that came second was counted and not written
                yield number, evaluation


def _named(db: sqlite3.Connection) -> tuple[set[int], bool]:
    """The numbers that the index of keys has, which lies on other pages than the rows; and whether all."""
    found: set[int] = set()
    try:
        # The index by keys may be whole where the rows are damaged.
        rows = db.execute(
            "SELECT number FROM evaluations INDEXED BY sqlite_autoindex_evaluations_1 ORDER BY key"
        )
        found.update(number for (number,) in rows)
    except DAMAGE:
        return found, False
    return found, True


def _last(db: sqlite3.Connection, path: Path, size: int) -> int:
    """The number of the row that was written last: from the table's end, or from the counter beside it."""
    tables = set()
    with contextlib.suppress(*DAMAGE):
        tables = {name for (name,) in db.execute("SELECT name FROM sqlite_master").fetchall()}
    # The counter first: its page may be whole where the table's end is lost.
    for query in ("SELECT seq FROM sqlite_sequence", "SELECT MAX(number) FROM evaluations"):
        with contextlib.suppress(*DAMAGE):
            found = db.execute(query).fetchone() if "evaluations" in tables else None
            # No more rows than bytes: a garbled counter would have this look for years.
            if found is not None and isinstance(found[0], int) and 0 < found[0] <= size:
                return found[0]
    raise DamagedStoreError(f"{path}: is damaged where it says what is in it, restore it from a copy")
