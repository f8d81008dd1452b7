"""How far a prediction can be believed, told from the pair: census residual, left-right consistency."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.census import CHANCE, CensusTarget

CONSISTENT = 1.0  # pixels by which the two views' disparities may differ
BLOCK = 7  # pixels each way over which residuals are averaged for the confidence

Map = NDArray[np.float32]


@dataclass(frozen=True)
class SelfCheck:
    """What a pair says about its own prediction.

    Attributes:
        residual: ``census``, percent of differing bits.
        inside: share of pixels whose match lies inside the right image.
        consistent: share of these whose match, predicted from the right view, leads back within 1 px.
        confidence: (H, W) from 0 to 1: 0 where the views disagree or the match lies outside; else 1 less the
            residual around the pixel, in parts of what unrelated images have.
    """

    residual: float
    inside: float
    consistent: float
    confidence: Map


def self_check(left: NDArray[np.uint8], right: NDArray[np.uint8], disparity: Map, of_right: Map) -> SelfCheck:
    """Check one prediction by the images and by that of the other view.

    Args:
        left: (H, W, 3) RGB uint8.
        right: the same of the right image.
        disparity: (H, W) in pixels, of the left view.
        of_right: the same of the right view, which a network predicts of the mirrored pair.
    """
    target = CensusTarget(left, right)
    found = target.residual(disparity)
    agree, inside = consistency(disparity, of_right)
    share = float(agree[inside].mean()) if inside.any() else 0.0
    return SelfCheck(found.score, found.inside, share, _confidence(target.map(disparity), agree & inside))


def consistency(of_left: Map, of_right: Map) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where both views' disparities (H, W) agree within 1 px, and where the match lies inside the image."""
    finite = np.isfinite(of_left)
    # Where the match lies in the right image: x - d.
    columns = np.arange(of_left.shape[1]) - np.rint(np.where(finite, of_left, 0)).astype(np.int64)
    inside = finite & (columns >= 0) & (columns < of_left.shape[1])
    back = np.take_along_axis(of_right, np.clip(columns, 0, of_left.shape[1] - 1), axis=1)
    # Infinities of both views may meet; such pixels are not inside.
    with np.errstate(invalid="ignore"):
        return inside & (np.abs(of_left - back) <= CONSISTENT), inside


def mean_around(residuals: Map) -> Map:
    """Residuals (H, W) averaged over the pixels around that have one; as unrelated images' where none has."""
    known = np.isfinite(residuals).astype(np.float32)
    total = cv2.boxFilter(np.nan_to_num(residuals), -1, (BLOCK, BLOCK), normalize=False)
    count = cv2.boxFilter(known, -1, (BLOCK, BLOCK), normalize=False)
    return np.divide(total, count, out=np.full_like(total, CHANCE), where=count > 0)


def _confidence(residuals: Map, agree: NDArray[np.bool_]) -> Map:
    # 1 where both views look alike, 0 where they look no more alike than unrelated images.
    confident = np.clip(1.0 - mean_around(residuals) / CHANCE, 0.0, 1.0)
    return np.asarray(np.where(agree, confident, 0.0), dtype=np.float32)
