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
mean over images everywhere. The rules were read from the evaluation code of OpenStereo (the platform of
StereoFactory's experiments), RAFT-Stereo, IGEV-Stereo and NMRF-Stereo.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from sfkit.datasets.metric import ImageSums, Mask, Metric
from sfkit.errors import InputError, ensure_known

# As in metric: names and rules are known before arrays are imported.
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sfkit.datasets.pairs import Sample

Values: TypeAlias = "NDArray[np.float64]"

DEFAULT_PROTOCOL = "openstereo"
PAIRS_PROTOCOL = "all-valid"
FAMILIES = ("eth3d", "kitti", "middlebury", "pairs")
MASK_FILES = {
    "eth3d": "mask0nocc.png beside the ground truth",
    "middlebury": "mask0nocc.png beside the images",
}


class ImageScore(ImageSums, Protocol):
    """One image's record, which also knows its value by a metric."""

    def value(self, metric: Metric | str, region: str = "all") -> float: ...


@dataclass(frozen=True)
class Rule:
    """What one protocol says about one family of data sets; a benchmark has it as ``benchmark.rule``.

    Attributes:
        visible_only: pixels seen in both views only; needs an occlusion mask.
        below: ground truth must be smaller than this, in pixels.
        pooled: shares over the pixels of all images together, instead of the mean over images; a metric
            says whether it joins in (EPE does not).
        metric: what the protocol reports where that is not the data set's own metric.
        resolutions: the resolutions the protocol is defined for; empty where it does not say.
        protocol: its name.
        family: of the data sets.
    """

    visible_only: bool = False
    below: float = math.inf
    pooled: bool = False
    metric: str | None = None
    resolutions: tuple[str, ...] = ()
    protocol: str = ""
    family: str = ""

    def in_range(self, sample: Sample) -> Mask:
        """(H, W) bool: ground truth within the protocol's range, occluded pixels included."""
        import numpy as np

        truth = sample.disparity
        # Unknown pixels are NaN, whose comparisons are False, as they should be, and warn.
        with np.errstate(invalid="ignore"):
            return np.asarray(np.isfinite(truth) & (truth > 0) & (truth < self.below))

    def valid_mask(self, sample: Sample) -> Mask:
        """(H, W) bool: the pixels that count.

        Raises:
            InputError: the protocol needs a mask that the sample lacks, or leaves no pixel of it.
        """
        mask = self.in_range(sample)
        if self.visible_only:
            if sample.nonoccluded is None:
                raise self.mask_missing(sample.id)
            mask &= sample.nonoccluded
        if not mask.any():
            raise InputError(
                f"{sample.id}: protocol {self.protocol!r} found no valid pixel, expected ground truth in "
                f"(0, {self.below:g}) px; leave the image out, or choose another protocol"
            )
        return mask

    def mask_missing(self, pair: str, truth: Path | None = None) -> InputError:
        """The refusal of a pair without the occlusion mask that is needed; ``truth`` is its file on disk."""
        found = "no occlusion mask" if truth is None else f"no mask0nocc.png beside {truth}"
        wanted = MASK_FILES.get(self.family, "a mask") if truth is None else "an occlusion mask"
        able = ", ".join(protocols_without_mask(self.family))
        return InputError(
            f"{pair}: protocol {self.protocol!r} counts visible pixels only, found {found}, expected "
            f"{wanted}; add it, or choose a protocol that does without: {able}"
        )

    def pools(self, metric: Metric) -> bool:
        """True where the score is of the pixels of all images together."""
        return self.pooled and metric.pools

    def terms(self, errors: Sequence[ImageScore], metric: Metric | str) -> tuple[Values, Values]:
        """The score as a ratio of two sums over images: numerators and denominators, each (N,).

        For a mean over images these are the images' values and ones; for a score pooled over pixels, 100
        times the bad pixels and the pixels that count. The score is sum / sum, of the benchmark as it is and
        of any resampling of its images.
        """
        import numpy as np

        metric = Metric.parse(metric)
        if self.pools(metric):
            counts = [metric.ratio(image) for image in errors]
        else:
            counts = [(image.value(metric), 1.0) for image in errors]
        # Sums and counts, not quotients: resamples of pooled metrics add both before they divide.
        numerators, denominators = np.array(counts, dtype=np.float64).reshape(-1, 2).T
        return numerators, denominators

    def aggregate(self, errors: Sequence[ImageScore], metric: Metric | str, *, region: str = "all") -> float:
        """The benchmark's score, in the metric's unit, from its images' records.

        For another region than ``all``, images without a pixel in it are left out.

        Raises:
            InputError: no image, an image without a valid pixel, or no pixel in the region.
        """
        metric = Metric.parse(metric)
        if not errors:
            raise InputError(f"protocol {self.protocol!r}: found no image to average, expected at least one")
        counted = list(errors) if region == "all" else [e for e in errors if e.region(region).pixels]
        if not counted:
            raise InputError(
                f"protocol {self.protocol!r}: found no valid pixel in region {region!r} of any image"
            )
        # Where scores are pooled too: this refuses an image without a valid pixel, which a sum would hide.
        values = [e.value(metric, region) for e in counted]
        if self.pools(metric):
            above, below = zip(*(metric.ratio(e, region) for e in counted), strict=True)
            return math.fsum(above) / math.fsum(below)
        return math.fsum(values) / len(values)


_RULES: dict[str, dict[str, Rule]] = {
    "openstereo": {
        "eth3d": Rule(visible_only=True, below=192),
        "middlebury": Rule(visible_only=True, below=192, resolutions=("H",)),
        "kitti": Rule(below=192),
    },
    "raft": {
        "eth3d": Rule(below=512),
        "middlebury": Rule(below=1000),
        "kitti": Rule(pooled=True, metric="bad-3.0"),
    },
    "igev": {
        "eth3d": Rule(visible_only=True, below=512),
        "middlebury": Rule(visible_only=True, below=192),
        "kitti": Rule(below=192, pooled=True, metric="bad-3.0"),
    },
    "nmrf": {
        "eth3d": Rule(below=512),
        "middlebury": Rule(below=1000, resolutions=("Q",)),
        "kitti": Rule(metric="bad-3.0"),
    },
    "all-valid": dict.fromkeys(FAMILIES, Rule()),
}
RULES = {
    name: {family: replace(one, protocol=name, family=family) for family, one in rules.items()}
    for name, rules in _RULES.items()
}


def rule(protocol: str, family: str) -> Rule:
    """The rule of one protocol for one family.

    Raises:
        InputError: no such protocol or family, or the protocol says nothing about the family.
    """
    ensure_known("protocol", protocol, RULES)
    ensure_known("family", family, FAMILIES)
    if family not in RULES[protocol]:
        able = ", ".join(rules_for(family))
        raise InputError(f"protocol {protocol!r} has no rule for {family!r}, expected one of: {able}")
    return RULES[protocol][family]


def rules_for(family: str) -> dict[str, Rule]:
    """The rules for a family, by protocol."""
    return {name: rules[family] for name, rules in RULES.items() if family in rules}


def protocols_without_mask(family: str) -> tuple[str, ...]:
    """The protocols that score a family without an occlusion mask."""
    return tuple(name for name, its_rule in rules_for(family).items() if not its_rule.visible_only)


def default_metric(protocol: str, family: str, own_metric: str) -> str:
    """What a protocol reports for a family where it says so, else the data set's own metric.

    Raises:
        InputError: an unknown protocol, or one without a rule for the family.
    """
    return rule(protocol, family).metric or own_metric
