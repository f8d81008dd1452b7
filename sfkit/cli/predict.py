"""``sfkit predict``: disparity, and depth, of image pairs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import JsonOption, emit, say
from sfkit.datasets.calibration import Calibration, read_calibration
from sfkit.errors import InputError
from sfkit.evaluation.prediction import match_pairs, predict_files
from sfkit.merging.network import load_network


def predict(
    file: Annotated[Path, typer.Argument(help="A merged network, or a checkpoint.", show_default=False)],
    left: Annotated[Path, typer.Option("--left", "-l", help="Left image, or a folder of them.")],
    right: Annotated[Path, typer.Option("--right", "-r", help="Right image, or a folder of them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("disparity"),
    form: Annotated[str, typer.Option(help="pfm, or png16 (disparity times 256).")] = "pfm",
    architecture: Annotated[
        str | None, typer.Option(help="For a checkpoint that does not say its architecture.")
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option("--calib", help="A calib.txt as Middlebury and ETH3D write it; gives depth."),
    ] = None,
    focal: Annotated[float | None, typer.Option(help="Focal length in pixels; gives depth.")] = None,
    baseline: Annotated[float | None, typer.Option(help="Distance of the cameras in metres.")] = None,
    json: JsonOption = False,
) -> None:
    """Write each pair's disparity with a colour preview, and its depth where the cameras are known.

    \b
    Examples:
      sfkit predict merged.safetensors --left im0.png --right im1.png -o out
      sfkit predict merged.safetensors -l left/ -r right/ --focal 721.5 --baseline 0.54 --form png16
    """
    pairs = match_pairs(left, right)
    cameras = _calibration(calibration, focal, baseline)
    model = load_network(file, name=architecture)
    rows = []
    for number, written in enumerate(predict_files(model, pairs, out, form=form, calibration=cameras), 1):
        say(f"{number} of {len(pairs)}: {written.disparity}")
        rows.append(
            {
                "disparity": written.disparity,
                "preview": written.preview,
                "depth": written.depth,
                "median_px": written.median,
                "nonfinite": written.nonfinite,
            }
        )
    text = "\n".join(f"{row['disparity']}: median {row['median_px']:.2f} px" for row in rows)
    emit({"predictions": rows}, text, as_json=json)


def _calibration(file: Path | None, focal: float | None, baseline: float | None) -> Calibration | None:
    if file is not None:
        if focal is not None or baseline is not None:
            raise InputError("expected --calib, or --focal with --baseline, not both")
        return read_calibration(file)
    if focal is None and baseline is None:
        return None
    if focal is None or baseline is None or focal <= 0 or baseline <= 0:
        raise InputError(f"--focal {focal} and --baseline {baseline}: expected both, above 0")
    return Calibration(focal, baseline)
