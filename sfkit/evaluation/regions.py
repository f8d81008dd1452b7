"""One image's ground truth, sorted into regions once, so that counting a prediction's errors costs little.

Which pixels count is the same for every candidate of a search; only the prediction changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.metric import D1_PIXELS, Mask
from sfkit.datasets.pairs import Sample
from sfkit.datasets.protocols import Rule

EDGE_PIXELS = 16
D1_SHARE = 0.05

Index = NDArray[np.intp]


@dataclass(frozen=True)
class Regions:
    """The pixels of one image that count, by region.

    Attributes:
        id: the pair's name.
        size: (H, W) of the image.
        used: flat indices of the pixels that lie in any region; None where all do.
        truth: (n,) the ground truth of those pixels, in the precision it came in: half the memory to read.
        inside: by region, positions among those pixels; None where all of them lie in it.
        near: by region, positions among its pixels whose disparity is so large that D1 asks for more than
            ``D1_PIXELS``, and (m,) float64 what it asks for there; everywhere else D1 is bad-3.
    """

    id: str
    size: tuple[int, ...]
    used: Index | None
    truth: NDArray[np.floating[Any]]
    inside: Mapping[str, Index | None]
    near: Mapping[str, tuple[Index, NDArray[np.float64]]]

    @classmethod
    def of(cls, name: str, truth: NDArray[np.floating[Any]], masks: Mapping[str, Mask]) -> Regions:
        """Sort the pixels of an image by masks (H, W); a pixel can lie in several regions, or in none."""
        used = np.flatnonzero(np.logical_or.reduce(list(masks.values())))
        values = truth.ravel().take(used)
        # In float64, like the errors they are compared with: 5 % of a float32 is none.
        bounds = D1_SHARE * values.astype(np.float64)
        inside: dict[str, Index | None] = {}
        near = {}
        for region, mask in masks.items():
            positions = np.flatnonzero(mask.ravel().take(used))
            # None stands for all: the usual region needs no gathering then, for every network anew.
            inside[region] = None if len(positions) == len(used) else positions
            own = bounds.take(positions)
            large = np.flatnonzero(own > D1_PIXELS)
            near[region] = (large, own.take(large))
        return cls(name, truth.shape, None if len(used) == truth.size else used, values, inside, near)

    def pixels(self, region: str) -> int:
        """How many pixels lie in a region."""
        positions = self.inside[region]
        return len(self.truth if positions is None else positions)


def regions_of(sample: Sample, valid: Mask, rule: Rule | None = None) -> Regions:
    """The regions of :class:`~sfkit.evaluation.metrics.ImageErrors`; none without ground truth.

    Args:
        sample: the pair with its ground truth.
        valid: (H, W) bool, which pixels count.
        rule: pixels in its range are split into visible and occluded, those that count unless given.
    """
    known = np.isfinite(sample.disparity) & (sample.disparity > 0)
    if not known.any():
        return Regions(sample.id, sample.size, np.zeros(0, np.intp), sample.disparity[known], {}, {})
    masks = {"all": valid & known, "edge": valid & known & edge_mask(sample.size)}
    if sample.nonoccluded is not None:
        # By range alone: where a protocol counts no occluded pixel, their region still has some.
        split = valid & known if rule is None else rule.in_range(sample)
        masks["visible"] = split & sample.nonoccluded
        masks["occluded"] = split & ~sample.nonoccluded
    return Regions.of(sample.id, sample.disparity, masks)


def edge_mask(size: tuple[int, int], width: int = EDGE_PIXELS) -> Mask:
    """(H, W) bool, True within ``width`` pixels of the image's border."""
    mask = np.ones(size, dtype=np.bool_)
    # An image narrower than two borders is border throughout.
    mask[width : max(size[0] - width, width), width : max(size[1] - width, width)] = False
    return mask
