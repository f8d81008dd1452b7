"""How the networks of each bank are trained: the numbers, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sfkit.bank import sharp
from sfkit.bank.folders import pool_file
from sfkit.datasets.synthetic.domains import BASE, BENCHMARK_PAIRS, SOURCES, Domain
from sfkit.errors import ensure_known
from sfkit.training.settings import TrainingSettings

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


Training = TrainingPlan | TrainingSettings


@dataclass(frozen=True)
class BankPlan:
    """One bank: its architecture, its worlds, and how base and sources are trained.

    Attributes:
        name: what :func:`sfkit.open_pool` calls it.
        architecture: the registry's name of its networks.
        base: the training of the base; settings of :func:`sfkit.finetune` for a bank that it trains.
        source: the training of a source.
        longer: sources that ``source`` left short of the bar, and how they are trained instead.
        options: the architecture's options.
        worlds: the base's domain, then the sources'.
        benchmarks: the collection its benchmarks stand in, a bank's name; see :func:`sfkit.open_benchmark`.
        pairs: of each of that collection's benchmarks.
        joint: whether one more network is trained on all sources' scenes together.
    """

    name: str
    architecture: str
    base: Training
    source: Training
    longer: Mapping[str, TrainingPlan] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=lambda: dict(OPTIONS))
    worlds: tuple[Domain, ...] = (BASE, *SOURCES)
    benchmarks: str = "bank"
    pairs: int = BENCHMARK_PAIRS
    joint: bool = False

    @property
    def networks(self) -> tuple[str, ...]:
        """Whatever is trained, in order: the base under its world's name, the sources, the joint one."""
        return (*(world.name for world in self.worlds), *([sharp.JOINT] if self.joint else ()))

    @property
    def pool_file(self) -> Path:
        """Its ``pool.toml``; base and sources lie beside it."""
        return pool_file(self.name)

    def plan_of(self, network: str) -> Training:
        """How the network of that name is trained."""
        return self.base if network == self.worlds[0].name else self.longer.get(network, self.source)


BANK = BankPlan(
    name="bank",
    architecture="anynet",
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
    base=TrainingPlan(steps=1400, peak_rate=2e-3, scenes=240),
    source=TrainingPlan(steps=120, peak_rate=2e-3, scenes=72, warm_up=25),
)
SHARP = BankPlan(
    name="bank-sharp",
    architecture="anynet-wide",
    base=sharp.BASE_SETTINGS,
    source=sharp.SOURCE_SETTINGS,
    options={"ranges": OPTIONS["ranges"]},
    worlds=(sharp.BASE, *sharp.SOURCES),
    benchmarks="bank-sharp",
    joint=True,
)
MAIN = SHARP
"""The bank that the demo searches and notebooks open; the first one remains, with what was recorded on it."""
BANKS = {plan.name: plan for plan in (BANK, SLIM, SHARP)}


def banks() -> tuple[str, ...]:
    """The names of the embedded banks that ship, the main one first."""
    return tuple(name for name, plan in BANKS.items() if plan.pool_file.exists())


def bank_plan(name: str) -> BankPlan:
    """The bank called ``name``, whether it ships or has to be built.

    Raises:
        InputError: no such bank; the nearest name is suggested.
    """
    ensure_known("embedded bank", name, BANKS)
    return BANKS[name]
