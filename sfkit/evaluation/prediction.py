"""Prediction: disparity, and depth where the calibration is known, of pairs without ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.colours import DISPARITY, paint, range_of
from sfkit.datasets.calibration import Calibration
from sfkit.datasets.formats import write_disparity_png16, write_png
from sfkit.datasets.images import read_image
from sfkit.datasets.matching import ensure_two, match_by_number
from sfkit.datasets.pfm import write_pfm
from sfkit.errors import InputError, SfkitError, unknown_name
from sfkit.evaluation.self_check import SelfCheck, self_check
from sfkit.files import unwritable
from sfkit.merging.network import LoadedNetwork

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".webp")
FORMS = ("pfm", "png16")


@dataclass(frozen=True)
class PredictionFiles:
    """What was written for one pair; depth and check where they were asked for."""

    disparity: Path
    preview: Path
    depth: Path | None
    median: float
    nonfinite: int
    confidence: Path | None = None
    check: SelfCheck | None = None


def match_pairs(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Two images, or the images of two folders matched by name (by number where no name is in both).

    Raises:
        InputError: a path is missing, a file meets a folder, both are one, the folders hold different
            numbers, some names are in both folders and some are not, or numbers differ.
    """
    for path in (left, right):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder, expected an image or a folder of images")
    ensure_two(left, right)
    if left.is_file() and right.is_file():
        return [(left, right)]
    if left.is_file() or right.is_file():
        raise InputError(f"{left} and {right}: found a file and a folder, expected two of one kind")
    lefts, rights = (_images(folder) for folder in (left, right))
    if len(lefts) != len(rights) or not lefts:
        raise InputError(
            f"{left} and {right}: found {len(lefts)} and {len(rights)} images, expected as many left as right"
        )
    by_name = {path.name: path for path in rights}
    alone = [path for path in lefts if path.name not in by_name]
    if len(alone) == len(lefts):
        return match_by_number(lefts, rights)
    if alone:
        raise InputError(
            f"{alone[0]}: found no image of that name in {right}, expected all names in both folders, or none"
        )
    return [(path, by_name[path.name]) for path in lefts]


def _images(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)


@torch.inference_mode()
def predict(model: LoadedNetwork, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Disparity (H, W) in pixels of the left image, from two (H, W, 3) RGB uint8 images."""
    pair = model.inputs.prepare(left, right)
    output = model.network(pair.left, pair.right)
    map_: NDArray[np.float32] = pair.window.crop(output.reshape(output.shape[-2:])).float().numpy()
    return map_


@dataclass(frozen=True)
class PredictionPlan:
    """Pairs that can be predicted and the files that will be written; make one with :meth:`of`.

    Attributes:
        pairs: left and right image files.
        stems: where each pair's files go, without their endings.
        form: ``pfm`` (float32) or ``png16`` (16-bit, disparity * 256).
        calibration: turns disparity into depth in metres.
        check: whether each prediction is checked by its pair, at the cost of a second one.
    """

    pairs: tuple[tuple[Path, Path], ...]
    stems: tuple[Path, ...]
    form: str
    calibration: Calibration | None
    check: bool = False

    @classmethod
    def of(
        cls,
        pairs: Sequence[tuple[Path, Path]],
        out: Path,
        *,
        form: str = "pfm",
        calibration: Calibration | None = None,
        check: bool = False,
        overwrite: bool = False,
    ) -> PredictionPlan:
        """Check all that would fail or be lost later, before a network is loaded; nothing is written.

        Args:
            pairs: left and right image files; every one is decoded.
            out: the folder for ``NAME.pfm`` or ``NAME.png``, ``NAME_colour.png``, ``NAME_depth.pfm``.
            form: ``pfm`` or ``png16``.
            calibration: asks for depth.
            check: asks for a check of each, and ``NAME_confidence.png``.
            overwrite: whether files that exist may be replaced; the images themselves never are.

        Raises:
            InputError: an unknown form, an image that cannot be read, two of unequal size, a place that
                cannot be written to, or a file that would be overwritten.
        """
        if form not in FORMS:
            raise unknown_name("form", form, FORMS)
        if (place := unwritable(out)) is not None:
            raise InputError(f"{out}: {place} is no folder that can be written to, choose another place")
        plan = cls(tuple(pairs), tuple(out / left.stem for left, _ in pairs), form, calibration, check)
        plan._check_targets(overwrite=overwrite)
        for left, right in pairs:
            _read_pair(left, right)
        return plan

    def targets(self, number: int) -> tuple[Path, ...]:
        """One pair's disparity, preview and, where asked for, depth and confidence."""
        suffix = ".pfm" if self.form == "pfm" else ".png"
        names = [suffix, "_colour.png", *(["_depth.pfm"] if self.calibration else [])]
        names += ["_confidence.png"] if self.check else []
        stem = self.stems[number]
        return tuple(stem.with_name(stem.name + name) for name in names)

    def _check_targets(self, *, overwrite: bool) -> None:
        images = {image.resolve() for pair in self.pairs for image in pair}
        claimed: dict[Path, Path] = {}
        for number, (left, _) in enumerate(self.pairs):
            for target in self.targets(number):
                if target.resolve() in images:
                    raise InputError(f"{target}: is one of the images, choose another folder for the results")
                if target.is_dir():
                    raise InputError(f"{target}: is a folder, choose another folder for the results")
                if target.exists() and not overwrite:
                    raise InputError(
                        f"{target}: the file exists, choose another folder or allow overwriting (--force)"
                    )
                if (other := claimed.setdefault(target, left)) != left:
                    raise InputError(f"{left} and {other}: would both be written to {target}, rename one")


def predict_files(model: LoadedNetwork, plan: PredictionPlan) -> Iterator[PredictionFiles]:
    """Predict pairs one after another and write each before the next.

    Raises:
        InputError: a disparity is too large for a 16-bit PNG.
        SfkitError: the network failed on a pair.
    """
    for number, (left, right) in enumerate(plan.pairs):
        first, second = _read_pair(left, right)
        try:
            disparity = predict(model, first, second)
            of_right = _of_right(model, first, second) if plan.check else None
        except Exception as error:  # whatever a network raises; the pair it raised on is what helps
            reason = str(error).partition("\n")[0]
            raise SfkitError(f"{left}: the network failed ({type(error).__name__}: {reason})") from error
        check = None if of_right is None else self_check(first, second, disparity, of_right)
        yield _write(disparity, plan.targets(number), plan, check)


def _of_right(model: LoadedNetwork, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Disparity (H, W) of the right view: the mirrored pair has its cameras in order again."""
    mirrored = (np.ascontiguousarray(image[:, ::-1]) for image in (right, left))
    return np.ascontiguousarray(predict(model, *mirrored)[:, ::-1])


def _read_pair(left: Path, right: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    first, second = read_image(left), read_image(right)
    if first.shape != second.shape:
        raise InputError(
            f"{right}: has {second.shape[1]}x{second.shape[0]} pixels, expected "
            f"{first.shape[1]}x{first.shape[0]} as in {left}"
        )
    return first, second


def _write(
    disparity: NDArray[np.float32], targets: Sequence[Path], plan: PredictionPlan, check: SelfCheck | None
) -> PredictionFiles:
    target, preview, *more = targets
    depth = more.pop(0) if plan.calibration is not None else None
    confidence = more.pop(0) if check is not None else None
    target.parent.mkdir(parents=True, exist_ok=True)
    finite = np.isfinite(disparity)
    if plan.form == "pfm":
        write_pfm(target, disparity)
    else:
        write_disparity_png16(target, np.where(finite & (disparity > 0), disparity, np.nan))
    write_png(preview, preview_of(disparity)[..., ::-1])
    if depth is not None and plan.calibration is not None:
        write_pfm(depth, depth_of(disparity, plan.calibration))
    if confidence is not None and check is not None:
        write_png(confidence, np.rint(255 * check.confidence).astype(np.uint8))
    median = float(np.median(disparity[finite])) if finite.any() else float("nan")
    broken = int((~finite).sum())
    return PredictionFiles(target, preview, depth, median, broken, confidence, check)


def depth_of(disparity: NDArray[np.float32], calibration: Calibration) -> NDArray[np.float32]:
    """Depth (H, W) in metres; infinite where disparity plus offset is not positive."""
    shifted = disparity + calibration.doffs
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = calibration.focal * calibration.baseline / shifted
    return np.where(shifted > 0, depth, np.inf).astype(np.float32)


def preview_of(disparity: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A picture (H, W, 3) in RGB from the 1st to the 99th percentile, hatched where values are not finite."""
    known = np.where(np.isfinite(disparity), disparity, np.float32(np.nan))
    return paint(known, range_of(disparity), DISPARITY)
