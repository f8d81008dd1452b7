"""How the bank's networks are trained: the numbers, in one place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

ARCHITECTURE = "anynet"
OPTIONS: dict[str, Any] = {"ranges": [4, 3, 3], "spn": False}
STAGE_WEIGHTS = (0.25, 0.5, 1.0)
"""Weights of AnyNet's three stages in the loss, coarse to fine (Wang et al., ICRA 2019, section IV)."""

HELD_OUT_PAIRS = 24
"""Pairs of a domain that a finished training is measured on."""


@dataclass(frozen=True)
class Plan:
    """One training: Adam, a linear warm-up to ``peak_rate``, then a cosine to zero.

    ``scenes`` are rendered once and visited in a new order each epoch, ``batch`` whole pairs a step;
    every ``save_every`` steps the state is written, so that a stopped training goes on from there.
    """

    steps: int
    peak_rate: float
    scenes: int
    batch: int = 6
    warm_up: int = 50
    save_every: int = 50
    seed: int = 1


BASE_PLAN = Plan(steps=2000, peak_rate=2e-3, scenes=300)
SOURCE_PLAN = Plan(steps=400, peak_rate=1e-3, scenes=160)
LONGER_PLANS = {
    "thin-things": Plan(steps=960, peak_rate=2e-3, scenes=200),
    "slanted-walls": Plan(steps=640, peak_rate=2e-3, scenes=160),
    "sensor-noise": Plan(steps=640, peak_rate=2e-3, scenes=160),
}
"""Sources that ``SOURCE_PLAN`` left only 14 to 18 % better than the base on their own domain."""


def plan_of(source: str) -> Plan:
    """How the source called ``source`` is trained."""
    return LONGER_PLANS.get(source, SOURCE_PLAN)
