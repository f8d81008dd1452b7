"""Where the notebooks lie: in a checkout beside the package, in a wheel inside it."""

from __future__ import annotations

from pathlib import Path

from sfkit.errors import InputError, unknown_name


def notebook_folder() -> Path:
    """The folder of the numbered notebooks.

    Raises:
        InputError: neither place has them, so the installation is incomplete.
    """
    package = Path(__file__).parent
    for folder in (package.parent / "notebooks", package / "notebook_files"):
        if any(folder.glob("*.ipynb")):
            return folder
    raise InputError(f"{package}: found no notebooks beside or inside the package, install sfkit again")


def notebook_path(name: str) -> Path:
    """The notebook called ``name``, such as ``01_quickstart``.

    Raises:
        InputError: there is no such notebook; the nearest name is suggested.
    """
    folder = notebook_folder()
    names = [path.stem for path in folder.glob("*.ipynb")]
    if name not in names:
        raise unknown_name("notebook", name, names)
    return folder / f"{name}.ipynb"
