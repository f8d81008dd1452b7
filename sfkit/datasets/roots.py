"""Paths named by manifests, tables and hints stay under the folder the caller gave."""

from __future__ import annotations

from pathlib import Path, PurePath

from sfkit.errors import InputError


def open_root(root: Path | str) -> Path:
    """The data folder as an absolute path; it may itself be a symbolic link.

    Raises:
        InputError: there is no such folder.
    """
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise InputError(f"{folder}: found no such folder, expected the folder that holds the data set")
    return folder.resolve()


def inside(root: Path, relative: PurePath | str) -> Path:
    """``root / relative``, which must not leave ``root`` by ``..``, as an absolute path or over a link.

    Raises:
        InputError: the path leads outside.
    """
    path = root / relative
    if not path.resolve().is_relative_to(root):
        raise InputError(
            f"{relative}: leads to {path.resolve()}, expected a path under {root}; "
            "copy the file there, or give a folder that holds all files"
        )
    return path
