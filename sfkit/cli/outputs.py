"""Places that will be written to, checked before anything is opened or computed for them."""

from __future__ import annotations

from pathlib import Path

from sfkit.errors import InputError
from sfkit.evaluation.store import EvaluationStore
from sfkit.files import unwritable


def check_file(argument: str, path: Path, ending: str, *, force: bool) -> None:
    """Refuse a file that cannot or should not be written.

    Args:
        argument: what the user gave the path as, such as ``--out``.
        path: the file.
        ending: what its name must end in, with the dot.
        force: whether a file that exists may be replaced.

    Raises:
        InputError: another ending, a folder, a file that exists, or no folder to write to.
    """
    if path.suffix != ending:
        raise InputError(f"{argument}: found {path}, expected a name that ends in {ending}")
    if path.is_dir():
        raise InputError(f"{argument}: {path} is a folder, expected the name of a file")
    if path.exists() and not force:
        raise InputError(f"{argument}: {path} exists, give another name or --force")
    _check_place(argument, path.absolute().parent)


def check_folder(argument: str, path: Path) -> None:
    """Refuse a folder that cannot be made or written to.

    Raises:
        InputError: it is a file, lies in one, or cannot be written to.
    """
    _check_place(argument, path.absolute())


def check_store(path: Path) -> None:
    """Refuse an evaluation store that cannot be used; one that does not exist is not made.

    Raises:
        InputError: there is no folder to make it in.
        StoreError: what is there is no evaluation store, or damaged.
    """
    _check_place("--store", path.absolute().parent)
    if path.exists():
        EvaluationStore(path).close()


def _check_place(argument: str, folder: Path) -> None:
    place = unwritable(folder)
    if place is None:
        return
    if place.is_dir():
        raise InputError(f"{argument}: {place} cannot be written to, choose another folder")
    raise InputError(f"{argument}: {place} is a file, expected a folder to write to")
