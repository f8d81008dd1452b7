"""How the networks of each bank are trained: the numbers, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sfkit.errors import unknown_name

OPTIONS: dict[str, Any] = {"ranges": [4, 3, 3], "spn": False}
STAGE_WEIGHTS = (0.25, 0.5, 1.0)
"""Weights of AnyNet's three stages in the loss, coarse to fine (Wang et al., ICRA 2019, section IV)."""

HELD_OUT_PAIRS = 24
"""Pairs of a domain that a finished training is measured on."""


@dataclass(frozen=True)
class TrainingPlan:
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


@dataclass(frozen=True)
class BankPlan:
    """One bank: its architecture, and how base and sources are trained.

    Attributes:
        name: what :func:`sfkit.open_pool` calls it.
        architecture: the registry's name of its networks.
        folder: where its networks ship, beside this file.
        base: the training of the base.
        source: the training of a source.
        longer: sources that ``source`` left short of the bar, and how they are trained instead.
        options: the architecture's options.
    """

    name: str
    architecture: str
    folder: str
    base: TrainingPlan
    source: TrainingPlan
    longer: Mapping[str, TrainingPlan] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=lambda: dict(OPTIONS))

    def plan_of(self, source: str) -> TrainingPlan:
        """How the source called ``source`` is trained."""
        return self.longer.get(source, self.source)


BANK = BankPlan(
    name="bank",
    architecture="anynet",
    folder="data",
    base=TrainingPlan(steps=2000, peak_rate=2e-3, scenes=300),
    source=TrainingPlan(steps=400, peak_rate=1e-3, scenes=160),
    # The common plan left these only 14 to 18 % better than the base on their own domain.
    longer={
        "thin-things": TrainingPlan(steps=960, peak_rate=2e-3, scenes=200),
        "slanted-walls": TrainingPlan(steps=640, peak_rate=2e-3, scenes=160),
        "sensor-noise": TrainingPlan(steps=640, peak_rate=2e-3, scenes=160),
    },
)
SLIM = BankPlan(
    name="bank-slim",
    architecture="anynet-slim",
    folder="data-slim",
    base=TrainingPlan(steps=1400, peak_rate=2e-3, scenes=240),
    source=TrainingPlan(steps=120, peak_rate=2e-3, scenes=72, warm_up=25),
)
BANKS = {plan.name: plan for plan in (BANK, SLIM)}


def banks() -> tuple[str, ...]:
    """The names of the embedded banks, the main one first."""
    return tuple(BANKS)


def bank_plan(name: str) -> BankPlan:
    """The bank called ``name``.

    Raises:
        InputError: no such bank; the nearest name is suggested.
    """
    if name not in BANKS:
        raise unknown_name("embedded bank", name, BANKS)
    return BANKS[name]
