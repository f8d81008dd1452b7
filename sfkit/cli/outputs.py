"""All files of one command: what it reads and what it will write, checked before any work.

A command makes one :class:`Places` and tells it of every path it was given, and so learns in time of a place
that cannot be written to, and of two names that are one file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from sfkit.errors import InputError
from sfkit.files import unwritable


class Places:
    """The files of a command, each with the argument that named it.

    Args:
        reads: argument -> a file the command reads, such as ``--recipe``; None where it was not given.
    """

    def __init__(self, **reads: Path | None) -> None:
        self._reads = {
            f"--{name.replace('_', '-')}": path for name, path in reads.items() if path is not None
        }
        self._writes: dict[object, str] = {}

    def reads(self, argument: str, path: Path | None) -> None:
        """A file the command reads and must not write to; None where it was not given."""
        if path is not None:
            self._reads[argument] = path

    def file(self, argument: str, path: Path | None, *endings: str, force: bool) -> None:
        """A file that will be written; nothing is checked of None.

        Args:
            argument: what the user gave the path as, such as ``--out``.
            path: the file.
            endings: what its name may end in, with the dot.
            force: whether a file that exists may be replaced.

        Raises:
            InputError: another ending, a folder, a file that exists or is another of the command's, or no
                folder to write to.
        """
        if path is None:
            return
        if path.suffix not in endings:
            raise InputError(f"{argument}: found {path}, expected a name that ends in {' or '.join(endings)}")
        if path.is_dir():
            raise InputError(f"{argument}: {path} is a folder, expected the name of a file")
        self.claim(argument, path)
        if path.exists() and not force:
            raise InputError(f"{argument}: {path} exists, give another name or --force")
        _check_place(argument, path.absolute().parent)

    def folder(self, argument: str, path: Path, names: Iterable[str]) -> None:
        """A folder that files of these names will be written to.

        Raises:
            InputError: it is a file, lies in one, or cannot be written to; or a folder or another of the
                command's files has one of the names.
        """
        _check_place(argument, path.absolute())
        for name in names:
            if (path / name).is_dir():
                raise InputError(f"{argument}: {path / name} is a folder, and a file of that name is written")
            self.claim(argument, path / name)

    def store(self, path: Path | None, argument: str = "--store") -> None:
        """An evaluation store that will be extended; one that does not exist is not made.

        Raises:
            InputError: there is no folder to make it in, or it is another of the command's files.
            StoreError: what is there is no evaluation store, or damaged.
        """
        if path is None:
            return
        from sfkit.evaluation.store_file import companions

        for file in (path, *companions(path)):
            self.claim(argument, file)
        _check_place(argument, path.absolute().parent)
        if path.exists():
            from sfkit.evaluation.store import EvaluationStore

            # Opened once, so that a damaged one is refused before any work.
            EvaluationStore(path).close()

    def claim(self, argument: str, path: Path) -> None:
        """A file that will be written, whatever it is called.

        Raises:
            InputError: the command reads it, or writes it as something else, under whatever name.
        """
        # Under whatever name: two paths to one file have a mark in common.
        marks = _marks(path)
        for other, read in self._reads.items():
            if not marks.isdisjoint(_marks(read)):
                raise InputError(f"{argument}: {path} is the file that {other} names, expected another one")
        held = next((self._writes[mark] for mark in marks if mark in self._writes), None)
        if held is not None:
            raise InputError(
                f"{argument}: {path} is a file that {held} writes to already, expected another name"
            )
        self._writes |= dict.fromkeys(marks, argument)


def _marks(path: Path) -> frozenset[object]:
    """What paths to one file have in common: its place and, where it exists, which file of the disk it is."""
    place = os.path.realpath(path)  # for links in a circle too
    try:
        found = path.stat()
    except OSError:
        return frozenset((place,))
    # Hard links of one file differ in their places alone.
    return frozenset((place, (found.st_dev, found.st_ino)))


def _check_place(argument: str, folder: Path) -> None:
    place = unwritable(folder)
    if place is None:
        return
    if place.is_dir():
        raise InputError(f"{argument}: {place} cannot be written to, choose another folder")
    raise InputError(f"{argument}: {place} is a file, expected a folder to write to")
