"""``sfkit bank``: the embedded networks, made again from their seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.groups import sub_commands
from sfkit.cli.options import NAMED, JsonOption, emit
from sfkit.cli.outputs import Places
from sfkit.cli.terminal import Bars
from sfkit.errors import InputError, ensure_known

app = sub_commands()


@app.command("build")
def build(
    name: Annotated[
        str,
        typer.Argument(help="bank; bank-slim: narrower networks, half the time; bank-sharp: stronger ones."),
    ] = "bank",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The folder to build in; runs/NAME unless given.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Render the domains and train base and sources from their seeds: about an hour on two cores.

    For bank-sharp it takes four hours of one core, and 6 GB for the scenes in rendered.
    Stopped at any moment and started again, it goes on where it was.

    \b
    Example:
      sfkit bank build
    """
    ensure_known("embedded bank", name, NAMED)
    out = out or Path("runs") / name
    places = Places()
    places.folder("--out", out, ("pool.toml", "base.safetensors", "trainings.json", "fingerprints.json"))
    # A pool that was put there by hand has no folder of trainings.
    if (out / "pool.toml").exists() and not (out / "training").is_dir():
        raise InputError(f"--out: {out / 'pool.toml'} exists, and no bank was built there: choose another")
    from sfkit.bank.building import build as build_bank

    with Bars() as bars:

        def advance(what: str, done: int, of: int) -> None:
            # A network is rendered, then trained: two bars.
            network, _, note = what.partition(": ")
            step = f"{network}, rendering" if note == "rendering" else network
            bars(step, done, of, note, line=f"{what}: {done} of {of}")

        build_bank(out, name, progress=advance)
    emit({"bank": out}, f"built {out}", as_json=json)
