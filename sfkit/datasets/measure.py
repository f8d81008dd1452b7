"""What can be measured on a benchmark: metric names, and the rules behind the protocol names.

The same prediction scores differently under each protocol, so a benchmark names the one it uses. The
rules were read from the evaluation code of OpenStereo (the platform of StereoFactory's experiments),
RAFT-Stereo, IGEV-Stereo and NMRF-Stereo. What is done with them is in :mod:`sfkit.evaluation`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum

from sfkit.errors import InputError, nearest, unknown_name

DEFAULT_PROTOCOL = "openstereo"
PAIRS_PROTOCOL = "all-valid"
FAMILIES = ("eth3d", "kitti", "middlebury", "pairs")

_BAD = re.compile(r"bad[-_ ]?(\d+(?:\.\d+)?)")


class Kind(StrEnum):
    """The three ways to measure an error map."""

    EPE = "epe"  # mean absolute error
    BAD = "bad"  # share of pixels whose error exceeds a threshold
    D1 = "d1"  # share of pixels whose error exceeds 3 px and 5 % of the truth (KITTI)


@dataclass(frozen=True)
class Metric:
    """A metric by kind; ``threshold`` in pixels is that of ``bad``, else 0. Lower is always better."""

    kind: Kind
    threshold: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Metric:
        """Read ``epe``, ``d1``, or ``bad-T`` with T in pixels (also written ``badT``).

        Raises:
            InputError: no such metric, or a threshold that is not above 0.
        """
        name = text.strip().lower()
        if name in (Kind.EPE, Kind.D1):
            return cls(Kind(name))
        match = _BAD.fullmatch(name)
        if match is None:
            hint = nearest(name, ("epe", "d1", "bad-0.5", "bad-1.0", "bad-2.0", "bad-3.0"))
            raise InputError(f"unknown metric {text!r}, expected epe, d1, or bad-T with T in pixels{hint}")
        if not 0 < (threshold := float(match[1])) < math.inf:
            raise InputError(f"metric {text!r}: found the threshold {match[1]}, expected more than 0 pixels")
        return cls(Kind.BAD, threshold)

    @property
    def name(self) -> str:
        """The one spelling used in tables and keys, such as ``bad-1.0``."""
        return f"bad-{self.threshold!r}" if self.kind is Kind.BAD else self.kind.value

    @property
    def unit(self) -> str:
        """``px`` or ``%``."""
        return "px" if self.kind is Kind.EPE else "%"

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Rule:
    """Which pixels of a family count, and how images are averaged.

    Attributes:
        visible_only: pixels seen in both views only; needs an occlusion mask.
        below: ground truth must be smaller than this, in pixels.
        pooled: bad-t and D1 over the pixels of all images together, instead of the mean over images.
            EPE is the mean over images in every protocol.
        metric: what the protocol reports where that is not the data set's own metric.
        resolutions: the resolutions the protocol is defined for; empty where it does not say.
    """

    visible_only: bool = False
    below: float = math.inf
    pooled: bool = False
    metric: str | None = None
    resolutions: tuple[str, ...] = ()


RULES: dict[str, dict[str, Rule]] = {
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


def rule(protocol: str, family: str) -> Rule:
    """The rule of one protocol for one family.

    Raises:
        InputError: no such protocol or family, or the protocol says nothing about the family.
    """
    if protocol not in RULES:
        raise unknown_name("protocol", protocol, RULES)
    if family not in FAMILIES:
        raise unknown_name("family", family, FAMILIES)
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
