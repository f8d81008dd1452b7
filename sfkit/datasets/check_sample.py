"""Does a loaded pair make sense: its images, its ground truth, and which image is the left one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.pairs import Sample

ENOUGH_PIXELS = 200  # below, nothing is said about left and right
SWAP_RATIO = 0.7  # correct pairs lie above 2 here, exchanged files at 0.25 to 0.5
SWAP_MARGIN = 0.02  # standard deviations of the image; keeps textureless pairs from warning
OUTSIDE_SHARE = 0.3  # of the ground truth; correct pairs lie below 0.15


@dataclass(frozen=True)
class Residuals:
    """Mean absolute grey difference, in standard deviations, under three readings of a pair.

    Attributes:
        as_given: left(x) against right(x - d).
        mirrored: left(x) against right(x + d): the images are exchanged, the ground truth fits the left one.
        exchanged: right(x) against left(x - d): the ground truth belongs to the image given as the right one.
        pixels: how many pixels were compared; only those with a partner under all three readings.
    """

    as_given: float
    mirrored: float
    exchanged: float
    pixels: int

    @property
    def swapped(self) -> bool:
        """True where another reading than the given one explains the images clearly better."""
        best = min(self.mirrored, self.exchanged)
        clear = best < SWAP_RATIO * self.as_given and self.as_given - best > SWAP_MARGIN
        return self.pixels >= ENOUGH_PIXELS and clear


def residuals(sample: Sample) -> Residuals:
    """Compare both images along the ground truth; see :class:`Residuals`."""
    left, right = _standard(sample.left), _standard(sample.right)
    rows, columns = np.nonzero(np.isfinite(sample.disparity))
    shift = np.rint(sample.disparity[rows, columns]).astype(np.int64)
    both = (columns - shift >= 0) & (columns + shift < left.shape[1])
    y, x, d = rows[both], columns[both], shift[both]
    if not y.size:
        return Residuals(0.0, 0.0, 0.0, 0)
    return Residuals(
        as_given=float(np.abs(left[y, x] - right[y, x - d]).mean()),
        mirrored=float(np.abs(left[y, x] - right[y, x + d]).mean()),
        exchanged=float(np.abs(right[y, x] - left[y, x - d]).mean()),
        pixels=int(y.size),
    )


def problems(sample: Sample) -> tuple[str, ...]:
    """What makes a pair useless, one sentence each; none for a sound pair."""
    known = np.isfinite(sample.disparity)
    found = []
    if not known.any():
        found.append("no ground truth is finite and positive; check the file and its coding")
    if np.array_equal(sample.left, sample.right):
        found.append("left and right are the same image; give the two views of the pair")
    found += [
        f"the {side} image is one flat colour; check the file"
        for side, image in (("left", sample.left), ("right", sample.right))
        if (image == image[:1, :1]).all()
    ]
    if known.any() and (share := float((sample.disparity[known] > sample.size[1]).mean())) > 0:
        found.append(
            f"{100 * share:.1f} % of the disparities exceed the image's width of {sample.size[1]} px; "
            "check the coding and its scale"
        )
    return tuple(found)


def warnings(sample: Sample) -> tuple[str, ...]:
    """What looks wrong but need not be, one sentence each."""
    found = []
    known = np.isfinite(sample.disparity)
    if known.any() and not np.array_equal(sample.left, sample.right) and residuals(sample).swapped:
        found.append("left and right look exchanged: the images match better the other way round")
    columns = np.broadcast_to(np.arange(sample.size[1]), sample.size)
    if known.any() and (outside := float((sample.disparity > columns)[known].mean())) > OUTSIDE_SHARE:
        found.append(
            f"{100 * outside:.0f} % of the ground truth points outside the right image; "
            "check the scale in its coding"
        )
    if sample.nonoccluded is not None and known.any() and not (sample.nonoccluded & known).any():
        found.append("the mask calls every pixel with ground truth occluded; check that 255 means visible")
    return tuple(found)


def _standard(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Grey values of mean 0 and standard deviation 1: exposure may differ between the views."""
    grey = image.mean(axis=2, dtype=np.float64)
    spread = float(grey.std())
    return np.asarray((grey - grey.mean()) / spread if spread else grey - grey.mean())
