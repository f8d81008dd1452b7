"""``sfkit show``: what a file is and how it was made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import JsonOption, emit


def show(
    file: Annotated[
        Path,
        typer.Argument(
            help="A network, a folder of them, a pool.toml, a recipe or a store.", show_default=False
        ),
    ],
    json: JsonOption = False,
) -> None:
    """Print what a file is and how it was made.

    \b
    Examples:
      sfkit show merged.safetensors
      sfkit show checkpoints/
    """
    # The folder of a search is shown as "runs show" does.
    if (file / "journal.jsonl").is_file():
        from sfkit.cli import runs

        runs.show(file, json)
        return
    from sfkit.cli.inspection import inspect_file

    description = inspect_file(file)
    emit(description.document, description.text, as_json=json)
