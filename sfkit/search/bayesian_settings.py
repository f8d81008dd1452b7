"""Settings of both stages by Bayesian optimisation: what a model of the score is asked, and how often."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar

from sfkit.errors import InputError
from sfkit.search.breeding import SubsetSettings
from sfkit.search.checks import LARGEST_POPULATION
from sfkit.search.routing_records import RoutingSettings
from sfkit.settings import between, positive, setting, whole

if TYPE_CHECKING:
    from sfkit.search.operators import SubsetSpace

PROPOSED = 41
"""Proposals of Stage 1, however many come at a time."""
LEAST_ROUNDS = 3


def rounds(batch: int) -> int:
    """How many times Stage 1's model proposes ``batch`` subsets, where nothing else was asked for.

    As many as make 41 proposals, and three at least: a batch learns nothing of itself.
    """
    return max(LEAST_ROUNDS, -(-PROPOSED // batch))


def _refuse_unused(settings: SubsetSettings | RoutingSettings, unused: Iterable[str], paper: type) -> None:
    """Refuse what the paper's search of that stage is asked, and no model, unless it is as it was."""
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if entry.name in unused and value != entry.default:
            raise InputError(
                f"{entry.name}: found {value!r}, expected {entry.default!r}: a search by a model does not "
                f"use it; take {paper.__name__} (--method paper)"
            )


@dataclass(frozen=True)
class BayesianSubsetSettings(SubsetSettings):
    """Settings of Stage 1 by a model.

    Attributes:
        population: how many subsets are scored before there is a model: all sources together, then random
            ones. The population of a generation is the best so many that are known.
        singles: whether every source is scored alone as well, before there is a model. It wins nothing, since
            a subset has two sources or more, but tells the model where the corners are.
        generations: how many times the model proposes.
        batch: q, candidates proposed at a time, for as many workers.
        beta: standard deviations that the bound lies below the mean; more explores more.
        seed: at least 0.
        crossover, mutation, redraw, survival: of :class:`SubsetSettings`, not used here.

    Raises:
        InputError: a value out of its range, or one for what is not used here.
    """

    UNUSED: ClassVar[tuple[str, ...]] = ("crossover", "mutation", "redraw", "survival")

    population: int = setting(
        8, help="Subsets scored before there is a model.", check=whole(2, LARGEST_POPULATION)
    )
    generations: int = setting(PROPOSED, help="How many times the model proposes.", check=whole(0))
    singles: bool = setting(default=True, help="Whether sources are scored alone as well.")
    batch: int = setting(1, help="Candidates proposed at a time (q).", check=whole(1))
    beta: float = setting(2.5, help="Deviations the bound lies below the mean.", check=between(0.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        _refuse_unused(self, self.UNUSED, SubsetSettings)

    @property
    def offspring(self) -> int:
        """Candidates that a generation creates."""
        return self.batch

    def proposals(self, space: SubsetSpace) -> int:
        """The most candidates of a search without starts that knows nothing before."""
        return self.alone(space) + min(self.population, space.subsets) + self.generations * self.batch

    def alone(self, space: SubsetSpace) -> int:
        """How many of them are one source each, and so no subset that may be chosen."""
        return len(space.allowed) if self.singles else 0


@dataclass(frozen=True)
class BayesianRoutingSettings(RoutingSettings):
    """Settings of Stage 2 by a model; what is not named here is as in :class:`RoutingSettings`.

    Where it stops paying was looked for with block-specific routing (``tied=False``), whose x has B x E + B
    entries, on the bank: E of 3, 4, 5, 6, 8 and 11 sources in B = 4 blocks, 16 to 48 entries, a search each.
    After 40 evaluations CMA-ES was ahead in one dimension, by 0.04 points with 24 entries; after 60, 80, 100
    and 150 it was in none, and for its score after 100 the model needed 3 to 68. What pays less and less is
    going on: after 150 the model was ahead of CMA-ES's 300 in two of six (28 and 36 entries) and 0.02 to 0.54
    points behind in four, where CMA-ES came to the model's score after 156 to 255; more than 150 by the model
    were not measured (``benchmarks/blockwise.py``).

    Attributes:
        evaluations: 80 by default.
        batch: q, candidates proposed at a time.
        beta: standard deviations that the bound of a bold proposal lies below the mean; half as many within
            the region.
        sigma: first radius of the trust region, a standard deviation of x.
        far: every second proposal is bold, without tied weights every third: of draws around the best whose
            first radii lie between 0.05 and this, their logarithms evenly; later ones are a third and less.
            0 proposes none boldly.
        patience: proposals within the region without a better one after which it halves; half as many better
            ones in a row double it.
        smallest: radius below which a region ends, and the next begins at ``sigma``.
        holdout: 0 alone; population, converge, tolfun and tolx are CMA-ES's and not used here.

    Raises:
        InputError: a value out of its range, or one for what is not used here.
    """

    UNUSED: ClassVar[tuple[str, ...]] = ("population", "converge", "tolfun", "tolx")

    evaluations: int = setting(80, help="Evaluations at most (N_eval).", check=whole(1))
    batch: int = setting(1, help="Candidates proposed at a time (q).", check=whole(1))
    beta: float = setting(
        2.0, "--stage2-beta", help="Deviations a bold bound lies below the mean.", check=between(0.0)
    )
    far: float = setting(1.5, help="Largest radius of bold proposals; 0 for none.", check=between(0.0))
    patience: int = setting(4, help="Proposals without a gain that shrink the region.", check=whole(1))
    smallest: float = setting(0.02, help="Radius at which the region begins again.", check=positive)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.holdout != 0:
            raise InputError(
                f"holdout: found {self.holdout!r}, expected 0: the model learns from all validation pairs; "
                "use RoutingSettings (--method paper) to hold some out"
            )
        _refuse_unused(self, self.UNUSED, RoutingSettings)
