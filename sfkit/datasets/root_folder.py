"""Folders of data: found or refused before anything of them is read; nothing is taken from outside them."""

from __future__ import annotations

import os
from pathlib import Path, PurePath

from sfkit.errors import InputError
from sfkit.files import home


def open_root(root: Path | str) -> Path:
    """The data folder as an absolute path; it may itself be a symbolic link.

    Raises:
        InputError: there is no such folder.
    """
    folder = home(root)
    if not folder.is_dir():
        raise InputError(f"{folder}: found no such folder, expected the folder that holds the data set")
    return folder.resolve()


def inside(root: Path, relative: PurePath | str) -> Path:
    """``root / relative``, which must not leave ``root`` by ``..`` or as an absolute path.

    Links that lie there are followed wherever they lead: whoever owns the folder has put them there.

    Raises:
        InputError: the path leads outside, or no file can have its name.
    """
    path = Path(os.path.normpath(root / relative))
    try:
        # Asks the system whether a file can have this name: it may be too long, or hold a zero byte.
        path.lstat()
    except (OSError, ValueError) as error:
        if not isinstance(error, FileNotFoundError | NotADirectoryError):
            raise InputError(f"{str(relative)[:100]!r}: is no name of a file ({error.args[-1]})") from error
    if not path.is_relative_to(root) and not Path(os.path.realpath(path)).is_relative_to(root):
        raise InputError(
            f"{relative}: leads to {path}, expected a path under {root}; "
            "copy the file there, or give a folder that holds all files"
        )
    return path
