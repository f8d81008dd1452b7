"""``sfkit init``: a ``pool.toml`` for a folder of checkpoints."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import ForceOption, JsonOption, emit
from sfkit.errors import InputError
from sfkit.files import write_text


def init(
    folder: Annotated[Path, typer.Argument(help="A folder of checkpoints.", show_default=False)],
    name: Annotated[str | None, typer.Option(help="The pool's name; the folder's unless given.")] = None,
    base: Annotated[str | None, typer.Option(help="The base's file name; guessed unless given.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write a commented pool.toml: the architecture by the keys, the base as what all others are nearest to.

    \b
    Examples:
      sfkit init checkpoints/
      sfkit init checkpoints/ --base sceneflow.tar
    """
    target = folder / "pool.toml"
    if target.exists() and not force:
        raise InputError(f"{target}: the file exists, allow overwriting it (--force)")
    from sfkit.merging.recognition import family, pool_toml

    found = family(folder, base)
    write_text(target, pool_toml(found, name or folder.resolve().name))
    lines = [
        f"wrote {target}: {found.architecture}, {len(found.sources)} sources, base {found.base.name} "
        + ("" if base else "(guessed; --base FILE says another)"),
        *(f"  {path.name}: cosine to the base {found.cosines[path]:.3f}" for path in found.sources),
        *(f"  left out {why}" for why in found.skipped.values()),
        f"fill in the licences; sfkit check {shlex.quote(str(folder))} says whether the network is called "
        "rightly",
    ]
    document = {
        "pool": str(target),
        "architecture": found.architecture,
        "base": found.base.name,
        "sources": {path.name: found.cosines[path] for path in found.sources},
        "skipped": list(found.skipped.values()),
    }
    emit(document, "\n".join(lines), as_json=json)
