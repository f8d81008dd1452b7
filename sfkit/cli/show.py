"""``sfkit show``: what a file is and how it was made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import NAMED, JsonOption, emit
from sfkit.merging.named import named_pool


def show(
    file: Annotated[
        Path,
        typer.Argument(
            help="A network, a folder of them, a pool.toml, bank, a recipe or a store.", show_default=False
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
    if str(file) in NAMED and not file.exists():  # as every command that takes a pool
        file = Path(named_pool(str(file)))
    # The folder of a search is shown as "runs show" does.
    if (file / "journal.jsonl").is_file():
        from sfkit.cli import runs

        runs.show(file, json)
        return
    from sfkit.cli.inspection import inspect_file

    description = inspect_file(file)
    emit(description.document, description.text, as_json=json)
