"""The numbered notebooks that ship with sfkit, by name."""

from __future__ import annotations

from pathlib import Path

from sfkit import files
from sfkit.errors import InputError, ensure_known


def notebook_folder() -> Path:
    """The folder of the numbered notebooks.

    Raises:
        InputError: they are neither beside nor in the package, so the installation is incomplete.
    """
    folder = files.shipped("notebooks", "notebook_files")
    if folder is None:
        raise InputError(
            f"{files.PACKAGE}: found no notebooks beside or inside the package, install sfkit again"
        )
    return folder


def notebook_path(name: str) -> Path:
    """The notebook called ``name``, such as ``01_quickstart``.

    Raises:
        InputError: there is no such notebook; the nearest name is suggested.
    """
    folder = notebook_folder()
    names = [path.stem for path in folder.glob("*.ipynb")]
    ensure_known("notebook", name, names)
    return folder / f"{name}.ipynb"
