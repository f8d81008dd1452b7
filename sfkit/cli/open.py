"""``sfkit open``: a notebook that comes with sfkit, as a copy of one's own, in JupyterLab."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import JsonOption, emit
from sfkit.errors import InputError


def open_notebook(
    name: Annotated[
        str, typer.Argument(help="Such as 01_quickstart; a part of the name will do.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to copy to.")] = Path("notebooks"),
    lab: Annotated[bool, typer.Option("--lab/--no-lab", help="Start JupyterLab, or only copy.")] = True,
    json: JsonOption = False,
) -> None:
    """Copy a notebook that comes with sfkit and open it in JupyterLab; a copy that is there is kept.

    \b
    Examples:
      sfkit open 01_quickstart
      sfkit open inspector --out work --no-lab
    """
    from sfkit.files import ensure_writable, write_bytes
    from sfkit.reports.notebooks import notebook_folder, notebook_path

    stems = sorted(path.stem for path in notebook_folder().glob("*.ipynb"))
    # A part of the name will do where one notebook alone has it.
    alike = [stem for stem in stems if name in stem]
    found = notebook_path(name if name in stems or len(alike) != 1 else alike[0])
    if lab and importlib.util.find_spec("jupyterlab") is None:
        raise InputError(
            "JupyterLab is not installed: pip install 'sfkit[jupyter]', or copy alone (--no-lab)"
        )
    ensure_writable(out, "--out", "choose another one")
    target = out / found.name
    kept = target.exists()
    if not kept:
        out.mkdir(parents=True, exist_ok=True)
        write_bytes(target, found.read_bytes())
    emit({"notebook": target, "kept": kept}, f"{'kept' if kept else 'wrote'} {target}", as_json=json)
    if lab:
        # -P: a json.py beside the notebook must not be taken for Python's own.
        raise typer.Exit(subprocess.call([sys.executable, "-P", "-m", "jupyterlab", str(target)]))
