"""``sfkit data check``: what is in a folder of stereo pairs, before anything is computed on it."""

from __future__ import annotations

from typing import Annotated

import typer

from sfkit.cli.foreseen import ensure_root
from sfkit.cli.groups import PanelCommand, grouped, sub_commands
from sfkit.cli.options import JsonOption, emit
from sfkit.cli.panels import FolderOptions
from sfkit.cli.terminal import Bars
from sfkit.datasets.shipped import ensure_data_set, source_manifest_names
from sfkit.errors import InputError

SAID_EVERY = 100  # pairs

app = sub_commands()


@app.command("check", cls=PanelCommand)
@grouped
def check(
    name: Annotated[
        str,
        typer.Argument(
            help="A benchmark (eth3d, kitti2015, ...), a training set (sceneflow, vkitti2, ...), pairs, or "
            "unlabelled."
        ),
    ],
    folder: FolderOptions,
    json: JsonOption = False,
) -> None:
    """Say what was found, what is missing, and whether images, sizes and ground truth make sense.

    \b
    Example:
      sfkit data check eth3d --root ~/ETH3D
      sfkit data check vkitti2 --root ~/VirtualKITTI2
    """
    ensure_data_set(name, *source_manifest_names())
    root = ensure_root(name, folder.root)
    if name in source_manifest_names():
        given = next((o for key, o in vars(folder).items() if key != "root" and o is not None), None)
        if given is not None:
            raise InputError(f"{name}: found {given!r}, its manifest says how it is read; leave it out")
        from sfkit.datasets.check_source import check_training_set

        report = check_training_set(name, root)
    else:
        from sfkit.datasets.check import check_data

        with Bars(keep=False) as bars:

            def advance(done: int, total: int) -> None:
                line = f"{name}: {done} of {total} pairs checked"
                bars(name, done, total, line=line if done % SAID_EVERY == 0 else None)

            report = check_data(
                name,
                root,
                resolution=folder.resolution,
                coding=folder.coding,
                table=folder.csv,
                every=folder.every,
                progress=advance,
            )
    emit(report.to_dict(), report.to_text(), as_json=json)
    if report.problems:
        raise typer.Exit(1)
