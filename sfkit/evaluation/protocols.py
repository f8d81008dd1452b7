"""Named evaluation protocols: which pixels count, and how images become one number.

| protocol | ETH3D | Middlebury | KITTI 2012, 2015 |
|---|---|---|---|
| openstereo | visible, d < 192 | H, visible, d < 192 | d < 192; D1 (3 px and 5 %) |
| raft | d < 512 | d < 1000 | all; > 3 px only, pooled |
| igev | visible, d < 512 | visible, d < 192 | d < 192; > 3 px only, pooled |
| nmrf | d < 512 | Q, d < 1000 | all; > 3 px only |
| all-valid | all | all | all; D1 |

"All" is every pixel whose ground truth d is finite and positive. What RAFT-Stereo and IGEV-Stereo
print as "D1" on KITTI lacks the 5 % term, and NMRF's zero-shot figures there are bad-3.0, so the
default metric of these three is ``bad-3.0``; asking for ``d1`` gives KITTI's own definition under every
protocol. ``all-valid`` is ours, for folders of pairs. Means are over images unless pooled; EPE is the
mean over images everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.measure import RULES, Kind, Metric, Rule, protocols_without_mask, rule
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError, unknown_name
from sfkit.evaluation.metrics import THRESHOLDS, ImageErrors, Map, count_errors
from sfkit.evaluation.regions import Regions, regions_of

MASK_FILES = {
    "eth3d": "mask0nocc.png beside the ground truth",
    "middlebury": "mask0nocc.png beside the images",
}


@dataclass(frozen=True)
class Protocol:
    """One named rule of evaluation."""

    name: str

    def rule(self, family: str) -> Rule:
        """The rule for one family; raises InputError where the protocol has none."""
        return rule(self.name, family)

    def needs_mask(self, family: str) -> bool:
        """True where only pixels seen in both views count."""
        return self.rule(family).visible_only

    def split_mask(self, sample: Sample, family: str) -> NDArray[np.bool_]:
        """(H, W) bool: ground truth within the protocol's range, occluded pixels included."""
        truth = sample.disparity
        with np.errstate(invalid="ignore"):
            return np.asarray(np.isfinite(truth) & (truth > 0) & (truth < self.rule(family).below))

    def valid_mask(self, sample: Sample, family: str) -> NDArray[np.bool_]:
        """(H, W) bool: the pixels that count.

        Raises:
            InputError: the protocol has no rule for the family, needs a mask that the sample lacks,
                or leaves no pixel of it.
        """
        mask = self.split_mask(sample, family)
        if self.needs_mask(family):
            if sample.nonoccluded is None:
                able = ", ".join(protocols_without_mask(family))
                raise InputError(
                    f"{sample.id}: protocol {self.name!r} counts visible pixels only, found no occlusion "
                    f"mask, expected {MASK_FILES.get(family, 'a mask')}; add it, or choose a protocol "
                    f"that does without: {able}"
                )
            mask &= sample.nonoccluded
        if not mask.any():
            raise InputError(
                f"{sample.id}: protocol {self.name!r} found no valid pixel, expected ground truth in "
                f"(0, {self.rule(family).below:g}) px; leave the image out, or choose another protocol"
            )
        return mask

    def errors(
        self, prediction: Map, sample: Sample, family: str, *, thresholds: Iterable[float] = THRESHOLDS
    ) -> ImageErrors:
        """One prediction's sums and counts under this protocol; raises as :meth:`valid_mask` does."""
        return count_errors(prediction, self.regions(sample, family), thresholds=thresholds)

    def regions(self, sample: Sample, family: str) -> Regions:
        """The pixels that count, by region, for any number of predictions; raises as :meth:`valid_mask`."""
        return regions_of(sample, self.valid_mask(sample, family), self.split_mask(sample, family))

    def aggregate(
        self, errors: Sequence[ImageErrors], metric: Metric | str, family: str, *, region: str = "all"
    ) -> float:
        """The benchmark's score: pixels for EPE, percent for bad-t and D1.

        For another region than ``all``, images without a pixel in it are left out.

        Raises:
            InputError: no image, an image without a valid pixel, or no pixel in the region.
        """
        metric = Metric.parse(metric) if isinstance(metric, str) else metric
        if not errors:
            raise InputError(f"protocol {self.name!r}: found no image to average, expected at least one")
        counted = list(errors) if region == "all" else [e for e in errors if e.region(region).pixels]
        if not counted:
            raise InputError(
                f"protocol {self.name!r}: found no valid pixel in region {region!r} of any image"
            )
        values = [e.value(metric, region) for e in counted]
        if self.rule(family).pooled and metric.kind is not Kind.EPE:
            bad = sum(e.count(metric, region) for e in counted)
            return 100.0 * bad / sum(e.region(region).pixels for e in counted)
        return math.fsum(values) / len(values)


PROTOCOLS: dict[str, Protocol] = {name: Protocol(name) for name in RULES}


def protocol(name: str) -> Protocol:
    """The protocol called ``name``.

    Raises:
        InputError: no such protocol; the nearest name is suggested.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
