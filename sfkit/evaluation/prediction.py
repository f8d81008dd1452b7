"""Prediction: disparity, and depth where the calibration is known, of pairs without ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.formats import write_disparity_png16
from sfkit.datasets.images import read_image
from sfkit.datasets.pfm import write_pfm
from sfkit.errors import InputError
from sfkit.merging.network import LoadedNetwork

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".webp")
FORMS = ("pfm", "png16")


@dataclass(frozen=True)
class PredictionFiles:
    """What was written for one pair; the depth map where a calibration was given."""

    disparity: Path
    preview: Path
    depth: Path | None
    median: float
    nonfinite: int


def match_pairs(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Two images, or the images of two folders matched by name (by order where the names differ).

    Raises:
        InputError: a path is missing, a file meets a folder, or the folders hold different numbers.
    """
    for path in (left, right):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder, expected an image or a folder of images")
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
    if all(path.name in by_name for path in lefts):
        return [(path, by_name[path.name]) for path in lefts]
    return list(zip(lefts, rights, strict=True))


def _images(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)


@torch.inference_mode()
def predict(model: LoadedNetwork, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Disparity (H, W) in pixels of the left image, from two (H, W, 3) RGB uint8 images."""
    pair = model.inputs.prepare(left, right)
    output = model.network(pair.left, pair.right)
    map_: NDArray[np.float32] = pair.window.crop(output.reshape(output.shape[-2:])).float().numpy()
    return map_


def predict_files(
    model: LoadedNetwork,
    pairs: list[tuple[Path, Path]],
    out: Path,
    *,
    form: str = "pfm",
    calibration: Calibration | None = None,
) -> Iterator[PredictionFiles]:
    """Predict pairs one after another and write each before the next.

    Args:
        model: the network.
        pairs: left and right image files.
        out: the folder for ``NAME.pfm`` or ``NAME.png``, ``NAME_colour.png``, ``NAME_depth.pfm``.
        form: ``pfm`` (float32) or ``png16`` (16-bit, disparity * 256).
        calibration: turns disparity into depth in metres.

    Raises:
        InputError: an unknown form, unequal image sizes, or a file that cannot be read.
    """
    if form not in FORMS:
        raise InputError(f"form: found {form!r}, expected one of {', '.join(FORMS)}")
    out.mkdir(parents=True, exist_ok=True)
    for left, right in pairs:
        first, second = read_image(left), read_image(right)
        if first.shape != second.shape:
            raise InputError(
                f"{right}: has {second.shape[1]}x{second.shape[0]} pixels, expected "
                f"{first.shape[1]}x{first.shape[0]} as in {left}"
            )
        yield _write(predict(model, first, second), out / left.stem, form, calibration)


def _write(
    disparity: NDArray[np.float32], stem: Path, form: str, calibration: Calibration | None
) -> PredictionFiles:
    target = stem.with_name(stem.name + (".pfm" if form == "pfm" else ".png"))
    finite = np.isfinite(disparity)
    if form == "pfm":
        write_pfm(target, disparity)
    else:
        write_disparity_png16(target, np.where(finite & (disparity > 0), disparity, np.nan))
    preview = stem.with_name(stem.name + "_colour.png")
    cv2.imwrite(str(preview), colour(disparity))
    depth = None
    if calibration is not None:
        depth = stem.with_name(stem.name + "_depth.pfm")
        write_pfm(depth, depth_of(disparity, calibration))
    median = float(np.median(disparity[finite])) if finite.any() else float("nan")
    return PredictionFiles(target, preview, depth, median, int((~finite).sum()))


def depth_of(disparity: NDArray[np.float32], calibration: Calibration) -> NDArray[np.float32]:
    """Depth (H, W) in metres; infinite where disparity plus offset is not positive."""
    shifted = disparity + calibration.doffs
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = calibration.focal * calibration.baseline / shifted
    return np.where(shifted > 0, depth, np.inf).astype(np.float32)


def colour(disparity: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A preview (H, W, 3) in OpenCV's channel order: viridis from the 1st to the 99th percentile.

    Pixels that are not finite are grey, not the colour of zero.
    """
    finite = np.isfinite(disparity)
    low, high = np.percentile(disparity[finite], (1, 99)) if finite.any() else (0.0, 1.0)
    scaled = (np.where(finite, disparity, low) - low) / max(float(high - low), 1e-6)
    levels = (np.clip(scaled, 0, 1) * 255).astype(np.uint8)
    image = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS), dtype=np.uint8)
    image[~finite] = 128
    return image
