"""``sfkit predict``: disparity, depth and points of image pairs, folders and videos."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.checkpoints.headers import ensure_checkpoint
from sfkit.cli.foreseen import ensure_loadable
from sfkit.cli.options import (
    ArchitectureOption,
    ForceOption,
    JsonOption,
    NetworkOption,
    emit,
    say,
)
from sfkit.cli.panels import PassOptions
from sfkit.cli.terminal import followed
from sfkit.errors import InputError

if TYPE_CHECKING:
    from sfkit.datasets.calibration import Calibration
    from sfkit.evaluation.prediction_files import Outputs, PredictionFiles, PredictionPlan
    from sfkit.evaluation.video_prediction import VideoPlan
    from sfkit.merging.network import LoadedNetwork

_LINES = 20  # of progress of a video, about, where there is no terminal


def predict(
    file: Annotated[Path, typer.Argument(help="A merged network, or a checkpoint.", show_default=False)],
    left: Annotated[Path, typer.Option("--left", "-l", help="Left image, a folder of them, or a video.")],
    compute: PassOptions,
    right: Annotated[
        Path | None, typer.Option("--right", "-r", help="Right image, a folder of them, or a video.")
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(help="Of a video of both views: side-by-side or top-bottom."),
    ] = None,
    every: Annotated[int, typer.Option(help="Of a video: predict one frame in so many.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("disparity"),
    form: Annotated[str, typer.Option(help="pfm, or png16 (disparity times 256).")] = "pfm",
    architecture: ArchitectureOption = None,
    option: NetworkOption = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calib",
            help="calib.txt of Middlebury, ETH3D or KITTI, or a K.txt; gives depth.",
        ),
    ] = None,
    cameras: Annotated[
        str | None,
        typer.Option(
            metavar="LEFT,RIGHT",
            help="The two in KITTI's file: 2,3 (colour) or 0,1 (grey).",
        ),
    ] = None,
    focal: Annotated[float | None, typer.Option(help="Focal length in pixels; gives depth.")] = None,
    baseline: Annotated[float | None, typer.Option(help="Distance of the cameras in metres.")] = None,
    cloud: Annotated[
        bool,
        typer.Option("--cloud", help="With --calib: a point cloud (PLY) of each."),
    ] = False,
    farthest: Annotated[
        float | None,
        typer.Option(help="Leave points out that are farther, in metres."),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Check each by its pair: residual, consistency, a confidence PNG."),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write the disparity of each pair and pictures of it; depth and points where the cameras are known.

    \b
    Examples:
      sfkit predict merged.safetensors --left im0.png --right im1.png -o out
      sfkit predict merged.safetensors -l left/ -r right/ --focal 721.5 --baseline 0.54 --form png16
      sfkit predict merged.safetensors -l im0.png -r im1.png --calib calib.txt --cloud --farthest 20
      sfkit predict merged.safetensors -l drive.mp4 --layout side-by-side --every 5 --check
    """
    ensure_checkpoint(file)
    known = _calibration(calibration, cameras, focal, baseline)
    if farthest is not None and not cloud:
        raise InputError(
            "--farthest: found no --cloud, expected the point cloud that it leaves points out of"
        )
    from sfkit.evaluation.prediction_files import Outputs

    outputs = Outputs(form, known, check, cloud, farthest)
    plan = _plan(left, right, layout, every, out, outputs, force=force)
    options = ensure_loadable(file, architecture, option)
    from sfkit.evaluation.stereo_model import load

    model = load(file, **compute.passes, architecture=architecture, options=options).loaded
    if known is not None:
        say(f"cameras: {known}")
    rows = list(_predicted(model, plan))
    # A video has one for all its frames, pairs have one each.
    overview = getattr(plan, "overview", None)
    text = "\n".join(map(_line, rows)) if overview is None else _summary(rows, overview)
    emit({"predictions": rows, "overview": overview}, text, as_json=json)


def _plan(
    left: Path,
    right: Path | None,
    layout: str | None,
    every: int,
    out: Path,
    outputs: Outputs,
    *,
    force: bool,
) -> PredictionPlan | VideoPlan:
    """Of two videos or one of both views, or of images and folders of them."""
    from sfkit.datasets.matching import match_pairs
    from sfkit.datasets.videos import VIDEO_SUFFIXES, StereoVideo
    from sfkit.evaluation.prediction_files import PredictionPlan
    from sfkit.evaluation.video_prediction import VideoPlan

    if layout is not None or left.suffix.lower() in VIDEO_SUFFIXES:
        return VideoPlan.of(StereoVideo(left, right, layout), out, outputs, every=every, overwrite=force)
    if right is None:
        raise InputError("--right is missing, expected the right image or folder (or --layout of a video)")
    if every != 1:
        raise InputError(f"--every is {every} and {left} is no video, expected images without --every")
    return PredictionPlan.of(match_pairs(left, right), out, outputs, overwrite=force)


def _predicted(model: LoadedNetwork, plan: PredictionPlan | VideoPlan) -> Iterator[dict[str, Any]]:
    """What was written of each pair or frame, said as it comes."""
    from sfkit.evaluation.prediction_files import PICTURES, PredictionPlan, predict_files
    from sfkit.evaluation.video_prediction import predict_video

    if isinstance(plan, PredictionPlan):
        pairs = plan.pairs

        def line(number: int, written: PredictionFiles) -> str:
            names = " and ".join(path.name for path in pairs[number - 1])
            return f"{number} of {len(pairs)}: {names} -> {written.disparity}"

        found = followed(predict_files(model, plan), line, total=len(pairs), what="pairs")
        for (left, right), written in zip(pairs, found, strict=True):
            yield {"left": left, "right": right, **_row(written)}
        return

    # A container need not say how many frames it has.
    total = plan.length

    def now_and_then(number: int, written: PredictionFiles) -> str | None:
        of = "" if total is None else f" of {total}"
        due = number in (1, total) or number % max(1, (total or 100) // _LINES) == 0
        return f"{number}{of}: {written.disparity}" if due else None

    for number, written in enumerate(
        followed(predict_video(model, plan), now_and_then, total=total, what="frames")
    ):
        row = _row(written)
        for picture in PICTURES:  # of all frames there is one video
            row.pop(picture)
        yield {"frame": number * plan.every, **row}


def _row(written: PredictionFiles) -> dict[str, Any]:
    row = {
        "disparity": written.disparity,
        "preview": written.preview,
        "overview": written.overview,
        "depth": written.depth,
        "median_px": written.median,
        "nonfinite": written.nonfinite,
    }
    if written.cloud is not None:
        row |= {"cloud": written.cloud, "points": written.points}
    if written.check is not None:
        row |= {
            "confidence": written.confidence,
            "census_percent": written.check.residual,
            "inside": written.check.inside,
            "consistent": written.check.consistent,
        }
    return row


def _line(row: Mapping[str, Any]) -> str:
    broken = f", {row['nonfinite']} pixels are not finite" if row["nonfinite"] else ""
    cloud = f", {row['points']:,} points" if "points" in row else ""
    check = ""
    if "consistent" in row:
        check = (
            f", census {row['census_percent']:.2f} %, {100 * row['consistent']:.0f} % consistent with the "
            f"right view, {100 * row['inside']:.0f} % of matches inside it; {Path(row['confidence']).name}"
        )
    return f"{row['disparity']}: median {row['median_px']:.2f} px{broken}{cloud}{check}"


def _summary(rows: Sequence[Mapping[str, Any]], overview: Path) -> str:
    """A video's lines: the first and the last frame, and where to look at all."""
    # The first and the last; of a single frame that one.
    lines = [_line(row) for row in rows[:: max(1, len(rows) - 1)]]
    broken = sum(bool(row["nonfinite"]) for row in rows)
    more = f", {broken} with pixels that are not finite" if broken else ""
    return "\n".join([*lines, f"{len(rows)} frames{more}; look at {overview}"])


def _calibration(
    file: Path | None, cameras: str | None, focal: float | None, baseline: float | None
) -> Calibration | None:
    from sfkit.datasets.calibration import Calibration, read_calibration

    if file is not None:
        if focal is not None or baseline is not None:
            raise InputError("expected --calib, or --focal with --baseline, not both")
        return read_calibration(file, None if cameras is None else _two(cameras))
    if cameras is not None:
        raise InputError("--cameras: found no --calib, expected the file whose cameras these are")
    if focal is None and baseline is None:
        return None
    return Calibration(_positive("--focal", focal), _positive("--baseline", baseline))


def _two(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d)\s*,\s*(\d)\s*", text, re.ASCII)
    if match is None:
        raise InputError(f"--cameras: found {text!r}, expected two numbers such as 2,3")
    return int(match[1]), int(match[2])


def _positive(argument: str, value: float | None) -> float:
    if value is None or not (math.isfinite(value) and value > 0):
        found = "is missing" if value is None else f"is {value:g}"
        raise InputError(f"{argument} {found}, expected --focal and --baseline, both finite and above 0")
    return value
