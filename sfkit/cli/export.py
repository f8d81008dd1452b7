"""``sfkit export``: a network as a file that runs without sfkit."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.foreseen import ensure_loadable
from sfkit.cli.groups import size_of
from sfkit.cli.options import (
    ArchitectureOption,
    ForceOption,
    JsonOption,
    NetworkOption,
    emit,
)
from sfkit.cli.outputs import Places
from sfkit.cli.terminal import say
from sfkit.errors import InputError, member_of


def export(
    file: Annotated[Path, typer.Argument(help="A merged network, or a checkpoint.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The file to write.", show_default="beside the network")
    ] = None,
    form: Annotated[str, typer.Option("--format", "-f", help="onnx, torch, torchscript or pth.")] = "onnx",
    size: Annotated[
        str | None,
        typer.Option(help="HEIGHTxWIDTH of the images.", show_default="the pair's, or 384x1248"),
    ] = None,
    dynamic: Annotated[bool, typer.Option("--dynamic", help="Take images of any size.")] = False,
    left: Annotated[
        Path | None, typer.Option("--left", "-l", help="Left image to check the file on.")
    ] = None,
    right: Annotated[Path | None, typer.Option("--right", "-r", help="Its right image.")] = None,
    architecture: ArchitectureOption = None,
    option: NetworkOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Write a network as ONNX, torch.export, TorchScript or a plain checkpoint, checked on a pair.

    \b
    Examples:
      sfkit export merged.safetensors --size 384x1248
      sfkit export merged.safetensors --dynamic -l im0.png -r im1.png -o stereo.onnx
    """
    options = ensure_loadable(file, architecture, option)
    from sfkit.exporting.forms import ENDINGS, Form, check_dynamic, check_export, check_size

    kind = member_of(Form, "format", form)
    out = out if out is not None else file.with_suffix(ENDINGS[kind][0])
    check_export(out, kind, overwrite=force)
    places = Places(left=left, right=right)
    places.reads("FILE", file)
    places.claim("--out", out)
    if (left is None) != (right is None):
        raise InputError("--left and --right: found one of them, expected both images of a pair")
    given = _size(size)
    check_size(given)
    if dynamic:
        check_dynamic(kind, given)
    from sfkit.datasets.images import read_image

    pair = None if left is None or right is None else (read_image(left), read_image(right))
    # Once more: only now is the pair's size known.
    check_size(given, pair)
    from sfkit.exporting.export import export_network

    exported = export_network(
        file,
        out,
        form=kind,
        size=given,
        dynamic=dynamic,
        pair=pair,
        architecture=architecture,
        options=options,
        overwrite=force,
        progress=say,
    )
    taken = (
        f"{exported.size[0]}x{exported.size[1]} (height x width)"
        if exported.size
        else f"any size in multiples of {exported.multiple}"
    )
    lines = [
        f"{exported.path}: {kind.value}, images of {taken}",
        f"beside the network on a pair of {exported.pair[0]}x{exported.pair[1]}: largest difference "
        f"{exported.largest:.2g} px, 99 % of pixels within {exported.percentile99:.2g} px",
    ]
    if not exported.agrees:
        lines.append("this file does not compute what the network does: do not deploy it")
    emit(asdict(exported) | {"agrees": exported.agrees}, "\n".join(lines), as_json=json)
    return 0 if exported.agrees else 1


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    size = size_of(text)
    if size is None:
        raise InputError(f"--size: found {text!r}, expected HEIGHTxWIDTH such as 384x1248")
    return size
