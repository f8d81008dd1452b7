"""``sfkit predict``: disparity, and depth, of image pairs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli.options import ForceOption, JsonOption, emit, network_options, say
from sfkit.errors import InputError

if TYPE_CHECKING:
    from sfkit.datasets.calibration import Calibration
    from sfkit.evaluation.prediction import PredictionFiles


def predict(
    file: Annotated[Path, typer.Argument(help="A merged network, or a checkpoint.", show_default=False)],
    left: Annotated[Path, typer.Option("--left", "-l", help="Left image, or a folder of them.")],
    right: Annotated[Path, typer.Option("--right", "-r", help="Right image, or a folder of them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("disparity"),
    form: Annotated[str, typer.Option(help="pfm, or png16 (disparity times 256).")] = "pfm",
    architecture: Annotated[
        str | None, typer.Option(help="For a checkpoint that does not say its architecture.")
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(help="An option of the architecture, such as spn=false.", metavar="NAME=VALUE"),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option("--calib", help="A calib.txt as Middlebury and ETH3D write it; gives depth."),
    ] = None,
    focal: Annotated[float | None, typer.Option(help="Focal length in pixels; gives depth.")] = None,
    baseline: Annotated[float | None, typer.Option(help="Distance of the cameras in metres.")] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Check each by its pair: residual, consistency, a confidence PNG."),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write each pair's disparity with a colour preview, and its depth where the cameras are known.

    \b
    Examples:
      sfkit predict merged.safetensors --left im0.png --right im1.png -o out
      sfkit predict merged.safetensors -l left/ -r right/ --focal 721.5 --baseline 0.54 --form png16
    """
    from sfkit.evaluation.prediction import PredictionPlan, match_pairs, predict_files
    from sfkit.merging.network import load_network

    pairs = match_pairs(left, right)
    cameras = _calibration(calibration, focal, baseline)
    options = network_options(option)
    plan = PredictionPlan.of(pairs, out, form=form, calibration=cameras, check=check, overwrite=force)
    model = load_network(file, name=architecture, options=options)
    rows = []
    for number, written in enumerate(predict_files(model, plan), 1):
        names = " and ".join(path.name for path in pairs[number - 1])
        say(f"{number} of {len(pairs)}: {names} -> {written.disparity}")
        rows.append(
            {
                "disparity": written.disparity,
                "preview": written.preview,
                "depth": written.depth,
                "median_px": written.median,
                "nonfinite": written.nonfinite,
                **_checked(written),
            }
        )
    text = "\n".join(_line(row) for row in rows)
    emit({"predictions": rows}, text, as_json=json)


def _checked(written: PredictionFiles) -> dict[str, Any]:
    """What the pair says about its prediction; nothing without ``--check``."""
    if written.check is None:
        return {}
    found = written.check
    return {
        "confidence": written.confidence,
        "census_percent": found.residual,
        "inside": found.inside,
        "consistent": found.consistent,
    }


def _line(row: Mapping[str, Any]) -> str:
    broken = f", {row['nonfinite']} pixels are not finite" if row["nonfinite"] else ""
    check = ""
    if "consistent" in row:
        check = (
            f", census {row['census_percent']:.2f} %, {100 * row['consistent']:.0f} % consistent, "
            f"{100 * row['inside']:.0f} % inside"
        )
    return f"{row['disparity']}: median {row['median_px']:.2f} px{broken}{check}"


def _calibration(file: Path | None, focal: float | None, baseline: float | None) -> Calibration | None:
    from sfkit.datasets.calibration import Calibration, read_calibration

    if file is not None:
        if focal is not None or baseline is not None:
            raise InputError("expected --calib, or --focal with --baseline, not both")
        return read_calibration(file)
    if focal is None and baseline is None:
        return None
    return Calibration(_positive("--focal", focal), _positive("--baseline", baseline))


def _positive(argument: str, value: float | None) -> float:
    if value is None or not (math.isfinite(value) and value > 0):
        found = "is missing" if value is None else f"is {value:g}"
        raise InputError(f"{argument} {found}, expected --focal and --baseline, both finite and above 0")
    return value
