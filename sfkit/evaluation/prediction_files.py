"""Predictions on disk: disparity, pictures, depth and points of one pair after another."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.formats import write_disparity_png16, write_png
from sfkit.datasets.images import read_image
from sfkit.datasets.pfm import write_pfm
from sfkit.errors import InputError, SfkitError, SfkitWarning, ensure_known
from sfkit.evaluation.point_cloud import depth_of, ensure_centre, point_cloud
from sfkit.evaluation.prediction import Image, Map, of_right, overview_of, predict, preview_of
from sfkit.evaluation.self_check import SelfCheck, self_check
from sfkit.files import ensure_writable

if TYPE_CHECKING:
    from sfkit.merging.network import LoadedNetwork

FORMS = ("pfm", "png16")


@dataclass(frozen=True)
class Outputs:
    """What is written of each prediction.

    Attributes:
        form: of the disparity: ``pfm`` (float32) or ``png16`` (16-bit, disparity * 256).
        calibration: asks for depth in metres.
        check: asks for a check of each prediction by its pair, at the cost of a second one.
        cloud: asks for a point cloud; with ``check``, without the pixels whose confidence is 0.
        farthest: points behind this depth in metres are left out.

    Raises:
        InputError: an unknown form, points without cameras, or a depth that is not a finite number above 0.
    """

    form: str = "pfm"
    calibration: Calibration | None = None
    check: bool = False
    cloud: bool = False
    farthest: float | None = None

    def __post_init__(self) -> None:
        ensure_known("form", self.form, FORMS)
        if self.cloud:
            if self.calibration is None:
                raise InputError("found a point cloud and no calibration, expected the cameras' too")
            ensure_centre(self.calibration)
        if self.farthest is not None and not (math.isfinite(self.farthest) and self.farthest > 0):
            raise InputError(f"farthest is {self.farthest:g}, expected metres, finite and above 0")

    @property
    def endings(self) -> dict[str, str]:
        """What is written -> what the name of its file ends in; pictures come apart from these."""
        found = {"disparity": ".pfm" if self.form == "pfm" else ".png"}
        if self.calibration is not None:
            found["depth"] = "_depth.pfm"
        if self.cloud:
            found["cloud"] = "_cloud.ply"
        if self.check:
            found["confidence"] = "_confidence.png"
        return found

    def check_size(self, image: Image) -> tuple[int, int]:
        """Height and width of an image; a calibration of images of another size is refused."""
        height, width = image.shape[:2]
        if self.calibration is not None:
            self.calibration.check_size(height, width)
        return height, width


PICTURES = {"preview": "_colour.png", "overview": "_overview.png"}
KINDS = (".pfm", "_depth.pfm", "_cloud.ply", "_confidence.png", *PICTURES.values())
"""What names of files of a prediction end in, but for PNGs, which a user's images are too."""


@dataclass(frozen=True)
class PredictionFiles:
    """What was written for one pair; depth, points and check where they were asked for.

    Attributes:
        disparity: the file of the disparity.
        median: of its finite values, pixels.
        nonfinite: how many pixels are not finite.
        preview: the disparity in colours; None for a frame of a video.
        overview: left image, disparity and confidence side by side; None for a frame of a video.
        depth: the file of the depth, metres.
        cloud: the file of the points.
        points: how many these are.
        confidence: the file of the confidence.
        check: what the pair says of its prediction.
    """

    disparity: Path
    median: float
    nonfinite: int
    preview: Path | None = None
    overview: Path | None = None
    depth: Path | None = None
    cloud: Path | None = None
    points: int = 0
    confidence: Path | None = None
    check: SelfCheck | None = None


@dataclass(frozen=True)
class PredictionPlan:
    """Pairs that can be predicted and the files that will be written; make one with :meth:`of`.

    Attributes:
        pairs: left and right image files.
        stems: where each pair's files go, without their endings.
        outputs: what is written of each.
        others: files that an earlier prediction of these images left, and this one does not replace.
    """

    pairs: tuple[tuple[Path, Path], ...]
    stems: tuple[Path, ...]
    outputs: Outputs = field(default_factory=Outputs)
    others: tuple[Path, ...] = ()

    @classmethod
    def of(
        cls,
        pairs: Sequence[tuple[Path, Path]],
        out: Path,
        outputs: Outputs | None = None,
        *,
        overwrite: bool = False,
    ) -> PredictionPlan:
        """Check all that would fail or be lost later, before a network is loaded; nothing is written.

        Args:
            pairs: left and right image files; every one is decoded.
            out: the folder for the files of each, which have the name of its left image.
            outputs: what is written of each.
            overwrite: whether files that exist may be replaced; the images themselves never are.

        Raises:
            InputError: an image that cannot be read, two of unequal size, a calibration of another size, a
                place that cannot be written to, or a file that would be overwritten.
        """
        ensure_writable(out, out, "choose another place")
        plan = cls(tuple(pairs), tuple(out / left.stem for left, _ in pairs), outputs or Outputs())
        plan._check_targets(overwrite=overwrite)
        # All pairs are read before any is predicted: what cannot be read is told before hours of work.
        sizes = [plan.outputs.check_size(_read_pair(left, right)[0]) for left, right in pairs]
        if plan.outputs.calibration is not None:
            _ensure_one_camera(plan.pairs, sizes)
        return replace(plan, others=tuple(plan._left_over()))

    def targets(self, number: int) -> dict[str, Path]:
        """What is written of one pair -> its file."""
        stem = self.stems[number]
        names = {**self.outputs.endings, **PICTURES}
        return {what: stem.with_name(stem.name + ending) for what, ending in names.items()}

    def _left_over(self) -> Iterator[Path]:
        """Where the pictures lie that every prediction leaves: other files of the name may be a user's."""
        written = {target for number in range(len(self.stems)) for target in self.targets(number).values()}
        # An image can be called what a prediction of another one would be.
        written |= {image for pair in self.pairs for image in pair}
        for stem in self.stems:
            there = {kind for kind in KINDS if stem.with_name(stem.name + kind).is_file()}
            # Both pictures tell a prediction's files from what else is called so.
            if there.issuperset(PICTURES.values()):
                found = (stem.with_name(stem.name + kind) for kind in KINDS if kind in there)
                yield from (path for path in found if path not in written)

    def _check_targets(self, *, overwrite: bool) -> None:
        # A link or another spelling must not hide that a result would replace its own image.
        images = {os.path.realpath(image) for pair in self.pairs for image in pair}
        claimed: dict[Path, Path] = {}
        for number, (left, _) in enumerate(self.pairs):
            for target in self.targets(number).values():
                if os.path.realpath(target) in images:  # where links lead in a circle, too
                    raise InputError(f"{target}: is one of the images, choose another folder for the results")
                ensure_free(target, overwrite=overwrite)
                if (other := claimed.setdefault(target, left)) != left:
                    raise InputError(f"{left} and {other}: would both be written to {target}, rename one")


def _ensure_one_camera(pairs: Sequence[tuple[Path, Path]], sizes: Sequence[tuple[int, int]]) -> None:
    for (left, _), (height, width) in zip(pairs, sizes, strict=True):
        if (height, width) != sizes[0]:
            raise InputError(
                f"{left}: has {width}x{height} pixels and {pairs[0][0]} {sizes[0][1]}x{sizes[0][0]}, "
                "expected images of one camera for one calibration; predict each camera's by themselves"
            )


def warn_of_others(paths: Sequence[Path]) -> None:
    """Say which files beside those written are of an earlier prediction, such as of a longer video."""
    if paths:
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        warnings.warn(
            f"{paths[0]}{more}: of an earlier prediction or your own, which this one did not replace; remove "
            "what could be taken for its own",
            SfkitWarning,
            stacklevel=2,
        )


def ensure_free(target: Path, *, overwrite: bool) -> None:
    """Refuse a folder, and a file that may not be replaced."""
    if target.is_dir():
        raise InputError(f"{target}: is a folder, choose another folder for the results")
    if target.exists() and not overwrite:
        raise InputError(f"{target}: the file exists, choose another folder or allow overwriting (--force)")


def predict_files(model: LoadedNetwork, plan: PredictionPlan) -> Iterator[PredictionFiles]:
    """Predict pairs one after another and write each before the next.

    Raises:
        InputError: a disparity is too large for a 16-bit PNG.
        SfkitError: the network failed on a pair.
    """
    for number, (left, right) in enumerate(plan.pairs):
        first, second = _read_pair(left, right)
        disparity, check = predict_checked(model, first, second, str(left), check=plan.outputs.check)
        targets = plan.targets(number)
        confidence = None if check is None else check.confidence
        targets["disparity"].parent.mkdir(parents=True, exist_ok=True)
        found = write_prediction(disparity, first, targets, plan.outputs, check)
        # OpenCV writes blue first.
        write_png(targets["preview"], preview_of(disparity)[..., ::-1])
        write_png(targets["overview"], overview_of(first, disparity, confidence)[..., ::-1])
        yield found
    warn_of_others(plan.others)


def predict_checked(
    model: LoadedNetwork, left: Image, right: Image, where: str, *, check: bool
) -> tuple[Map, SelfCheck | None]:
    """Disparity (H, W), and what the pair says of it where that is asked for.

    Raises:
        SfkitError: the network failed; ``where`` begins the sentence.
    """
    try:
        disparity = predict(model, left, right)
        other = of_right(model, left, right) if check else None
    except Exception as error:  # whatever a network raises; the pair it raised on is what helps
        reason = str(error).partition("\n")[0]
        raise SfkitError(f"{where}: the network failed ({type(error).__name__}: {reason})") from error
    return disparity, None if other is None else self_check(left, right, disparity, other)


def write_prediction(
    disparity: Map, left: Image, targets: dict[str, Path], outputs: Outputs, check: SelfCheck | None
) -> PredictionFiles:
    """Write what is asked for of one prediction; pictures are others' work."""
    finite = np.isfinite(disparity)
    if outputs.form == "pfm":
        write_pfm(targets["disparity"], disparity)
    else:
        write_disparity_png16(targets["disparity"], disparity)
    points = 0
    if outputs.calibration is not None:
        write_pfm(targets["depth"], depth_of(disparity, outputs.calibration))
        if outputs.cloud:
            # Without the points that the pair itself speaks against.
            keep = None if check is None else check.confidence > 0
            cloud = point_cloud(disparity, left, outputs.calibration, farthest=outputs.farthest, keep=keep)
            cloud.write(targets["cloud"])
            points = len(cloud.points)
    if check is not None:
        write_png(targets["confidence"], np.rint(255 * check.confidence).astype(np.uint8))
    median = float(np.median(disparity[finite])) if finite.any() else math.nan
    return PredictionFiles(
        median=median, nonfinite=int((~finite).sum()), points=points, check=check, **targets
    )


def _read_pair(left: Path, right: Path) -> tuple[Image, Image]:
    first, second = read_image(left), read_image(right)
    if first.shape != second.shape:
        raise InputError(
            f"{right}: has {second.shape[1]}x{second.shape[0]} pixels, expected "
            f"{first.shape[1]}x{first.shape[0]} as in {left}"
        )
    return first, second
