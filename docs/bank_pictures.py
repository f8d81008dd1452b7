"""Picture strips of the bank's domains: a pair, its ground truth, what a network makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.datasets import Sample

Picture = NDArray[np.uint8]
SHRINK = 0.65
ERROR_LIMIT = 6.0
"""Error in pixels that is shown as full white; 3, where a pixel counts as bad, is middle grey."""
QUALITY = 85


def strip(sample: Sample, prediction: NDArray[np.float32]) -> Picture:
    """Left view, right view, ground truth, prediction and error side by side, (h, 5 w, 3) RGB.

    Truth and prediction share one colour scale from 0 to the largest true disparity; the error is black
    at 0 px and white at 6 px. Pixels without ground truth are black in the truth and blue in the error.
    """
    largest = float(np.nanmax(sample.disparity))
    parts = [
        _small(sample.left, cv2.INTER_AREA),
        _small(sample.right, cv2.INTER_AREA),
        _small(colours(_thickened(sample.disparity), largest), cv2.INTER_NEAREST),
        _small(colours(prediction, largest), cv2.INTER_AREA),
        _small(error_map(sample, prediction), cv2.INTER_NEAREST),
    ]
    return np.hstack(parts)


def beside(sample: Sample, predictions: Sequence[NDArray[np.float32]]) -> Picture:
    """Left view and ground truth, then each prediction and its error, in :func:`strip`'s colours."""
    largest = float(np.nanmax(sample.disparity))
    parts = [
        _small(sample.left, cv2.INTER_AREA),
        _small(colours(_thickened(sample.disparity), largest), cv2.INTER_NEAREST),
    ]
    for prediction in predictions:
        parts.append(_small(colours(prediction, largest), cv2.INTER_AREA))
        parts.append(_small(error_map(sample, prediction), cv2.INTER_NEAREST))
    return np.hstack(parts)


def error_map(sample: Sample, prediction: NDArray[np.float32]) -> Picture:
    """The error (H, W, 3): black at 0 px, white at 6 px, blue without ground truth."""
    error = _thickened(np.abs(prediction - sample.disparity))
    grey = np.rint(255.0 * np.clip(np.nan_to_num(error) / ERROR_LIMIT, 0.0, 1.0)).astype(np.uint8)
    painted = np.repeat(grey[..., None], 3, axis=2)
    painted[~np.isfinite(error)] = (30, 30, 90)
    return painted


def colours(disparity: NDArray[np.float32], largest: float) -> Picture:
    """A disparity map in colour (H, W, 3): blue at 0, red at ``largest`` pixels, black where it is NaN."""
    share = np.clip(np.nan_to_num(disparity, nan=0.0) / largest, 0.0, 1.0)
    painted = cv2.applyColorMap(np.rint(255.0 * share).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where(np.isfinite(disparity)[..., None], painted, 0).astype(np.uint8)


def write_picture(path: Path, picture: Picture) -> None:
    """Write an RGB picture as JPEG, or whatever else the file's suffix says, making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    options = [cv2.IMWRITE_JPEG_QUALITY, QUALITY] if path.suffix == ".jpg" else []
    done, code = cv2.imencode(path.suffix, picture[..., ::-1], options)
    if not done:
        raise OSError(f"{path}: OpenCV could not encode a picture of shape {picture.shape}")
    path.write_bytes(code.tobytes())


def _thickened(sparse: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scan lines, a pixel thin, spread to their neighbours; shrinking a picture would lose most of them."""
    if np.isfinite(sparse).all():
        return sparse
    spread = cv2.dilate(np.nan_to_num(sparse, nan=-1.0), np.ones((3, 3), np.uint8))
    return np.where(np.isfinite(sparse), sparse, np.where(spread >= 0.0, spread, np.nan)).astype(np.float32)


def _small(picture: Picture, interpolation: int) -> Picture:
    small = cv2.resize(picture, None, fx=SHRINK, fy=SHRINK, interpolation=interpolation)
    return np.asarray(small, dtype=np.uint8)
