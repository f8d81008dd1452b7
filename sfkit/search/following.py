"""A search that runs elsewhere, followed by reading its journal, and nothing but reading."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from sfkit.errors import InputError, nearest
from sfkit.files import home
from sfkit.search.journal import JournalledSearch, Record, read_journal
from sfkit.search.runs import JOURNAL, STAGES


class FollowedJournal:
    """A journal that grows while it is read; safe to use from several threads.

    Args:
        path: the journal, the folder of a search, or a store with a journal beside it. A folder may
            still be without a journal: the search that will write it has not begun.

    Raises:
        InputError: no such file or folder, or a file with no journal beside it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = _journal(home(path))
        self._lock = threading.Lock()
        self._seen: tuple[int, int] | None = None
        self._records: tuple[Record, ...] = ()

    def records(self) -> tuple[Record, ...]:
        """Every whole record so far; the same tuple as before where nothing was written since.

        Raises:
            InputError: the journal is damaged.
        """
        with self._lock:
            try:
                found = self.path.stat()
            except FileNotFoundError:
                return ()
            # Size besides time: two records may be written within one tick of a file system's clock.
            seen = (found.st_size, found.st_mtime_ns)
            if seen != self._seen:
                self._records = read_journal(self.path)
                self._seen = seen
            return self._records

    def searches(self) -> tuple[str, ...]:
        """Which searches it tells of so far: ``subset``, ``routing``, in this order."""
        return tuple(kind for kind in STAGES if JournalledSearch.find(self.records(), kind) is not None)


def _journal(path: Path) -> Path:
    if path.is_dir():
        return path / JOURNAL
    if not path.exists():
        beside = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
        raise InputError(
            f"{path}: no such file or folder, expected a search's folder, journal or store"
            f"{nearest(path.name, beside)}"
        )
    if path.suffix == ".jsonl":
        return path
    if not (path.parent / JOURNAL).is_file():
        raise InputError(
            f"{path}: found no {JOURNAL} beside it, expected what a search with journal=Journal(...) writes: "
            "name the journal"
        )
    return path.parent / JOURNAL
