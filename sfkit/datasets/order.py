"""Which image is the left one, told without ground truth: matches in the right image lie to the left."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH = 256  # images are looked at in this width at most
REACH = 0.25  # of the width: the largest disparity that is looked for
BLOCK = 7  # pixels each way over which matching costs are averaged
# 33 pairs of nine real data sets and the bank lie below 0.86, exchanged above 1.25.
EXCHANGED = 1.04


@dataclass(frozen=True)
class PairOrder:
    """How well blocks match in either direction.

    Attributes:
        as_given: mean cost of each block's best match with a disparity above 0, in grey levels.
        exchanged: the same with a disparity below 0.
    """

    as_given: float
    exchanged: float

    @property
    def looks_exchanged(self) -> bool:
        """True where matches to the wrong side are clearly better."""
        return self.as_given > EXCHANGED * self.exchanged and self.as_given - self.exchanged > 0.1

    @property
    def doubt(self) -> str | None:
        """What looks wrong, in one sentence; None where nothing does."""
        if not self.looks_exchanged:
            return None
        return (
            "left and right look exchanged: the images match better the other way round "
            f"(cost {self.exchanged:.2f} in place of {self.as_given:.2f}); give the left camera's image first"
        )


def compare_orders(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> PairOrder:
    """Match blocks of the left image in the right one to either side; images are (H, W, 3) uint8."""
    first, second = _small(left), _small(right)
    reach = max(2, int(REACH * first.shape[1]))
    return PairOrder(
        *(float(_best(first, second, range(sign, sign * reach, sign)).mean()) for sign in (1, -1))
    )


def _small(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Grey values of mean 0 in a small image: exposure may differ between the views."""
    grey = image.mean(axis=2, dtype=np.float32)
    scale = min(1.0, WIDTH / grey.shape[1])
    size = (max(8, round(grey.shape[1] * scale)), max(8, round(grey.shape[0] * scale)))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    # Less the local mean: the cameras' exposures may differ.
    local = small - cv2.blur(small, (2 * BLOCK + 1, 2 * BLOCK + 1))
    return np.asarray(local, dtype=np.float32)


def _best(first: NDArray[np.float32], second: NDArray[np.float32], disparities: range) -> NDArray[np.float32]:
    """The cost of the best match, of the columns that have one of every disparity to both sides."""
    best = np.full(first.shape, np.inf, np.float32)
    for disparity in disparities:
        # Columns that roll round the edge are cut off below.
        cost = np.abs(first - np.roll(second, disparity, axis=1))
        np.minimum(best, cv2.blur(cost, (BLOCK, BLOCK)), out=best)
    reach = abs(disparities[-1]) + BLOCK
    return best[:, reach:-reach]
