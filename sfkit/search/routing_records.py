"""Stage 2 (StereoFactory, Algorithm 2) as records: its settings, candidates, state, and history."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sfkit.evaluation.holdout import check_holdout
from sfkit.search.base import SearchState
from sfkit.search.checks import LARGEST_POPULATION, check_gamma, check_rank
from sfkit.search.records import COMMON, ORIGIN, Candidate
from sfkit.settings import between, positive, setting, settle, whole

if TYPE_CHECKING:
    import pandas as pd

SMALLEST_POPULATION = 3
"""pycma refuses smaller ones."""


@dataclass(frozen=True)
class RoutingSettings:
    """Settings of Stage 2. The paper gives gamma, tied routing and lambda = 0; the rest is our choice.

    Attributes:
        evaluations: N_eval, at least 1. Every candidate counts, x = 0 and the start included, cached or
            not. A population that would cross it is cut to what is left: those candidates are scored and
            may win, and the search ends there.
        population: N_pop, at least 3; None takes pycma's 4 + floor(3 ln n) for n dimensions.
        sigma: initial step size sigma^(0), above 0. 0.5 makes a scale's standard deviation about 0.19 and
            a weight's up to half of itself.
        gamma: bounds of the module scales, with 1 in the middle.
        tied: True shares one row of weights between all blocks (E + B dimensions), False gives each
            block its own (B * E + B).
        rank: R >= 1, with ``tied=False``, makes routing low-rank: one row that all blocks share and R
            directions that each follows to a degree of its own (E + R (B + E) + B); None for neither.
        scaled: False fixes all module scales at 1.
        entropy: lambda, at least 0: the weight of the mean entropy added to the score (eq. 13), in the
            score's unit a nat.
        holdout: validation pairs held out from CMA-ES, by whose score the best is chosen: a share in
            (0, 1), or a whole number of folds of at least 2; 0, the paper's form, holds out none. Fewer than
            four pairs are not split, which a warning says. Evaluations and their keys are the same with it;
            folds use up the budget, whatever ``converge`` says.
        shrinkage: at least 0: what a recipe must gain, in shares of the score of x = 0, for each unit of
            its mean squared distance from x = 0, Stage 1's equal weights.
        converge: True ends the search as soon as one of pycma's stop conditions holds (tolfun, tolx,
            tolfunhist, tolstagnation, tolflatfitness, ...), False uses up the budget.
        tolfun: stop condition, range of recent fitness values, in the score's unit.
        tolx: stop condition, standard deviations of x.
        floor: where a ``start`` has a weight of 0 or a scale on its bound, the search begins this far
            inside, in (0, 0.5), since the boundary itself lies at infinity.
        seed: at least 0; the same seed and the same scores give the same search.

    Raises:
        InputError: a value out of its range.
    """

    evaluations: int = setting(
        300, help="Evaluations at most (N_eval); 0 leaves Stage 2 out of a search.", check=whole(1)
    )
    population: int | None = setting(
        None,
        "--stage2-population",
        help="Candidates in a generation (N_pop); 4 + 3 ln n for n dimensions unless given.",
        check=whole(SMALLEST_POPULATION, LARGEST_POPULATION),
    )
    sigma: float = setting(0.5, help="Initial step size (sigma).", check=positive)
    gamma: tuple[float, float] = setting(
        (0.25, 1.75), help="Bounds of the module scales, with 1 in the middle.", check=check_gamma
    )
    tied: bool = setting(
        True, "--tied/--block-specific", help="One row of routing weights, or one for every block."
    )
    scaled: bool = setting(default=True, help="Whether module scales are searched; without, all are 1.")
    rank: int | None = setting(
        None, help="Rank of low-rank routing, between tied and block-specific.", check=whole(1)
    )
    entropy: float = setting(0.0, help="Weight of the entropy penalty.", check=between(0.0))
    holdout: float = setting(
        0.0,
        help="Choose on held-out pairs: a share such as 0.5, or folds such as 4.",
        check=check_holdout,
    )
    shrinkage: float = setting(0.0, help="Pull towards Stage 1, in shares of its score.", check=between(0.0))
    converge: bool = setting(default=True, help="Whether it ends where CMA-ES has converged.")
    tolfun: float = setting(1e-11, help="Converged: range of recent scores.", check=between(0.0))
    tolx: float = setting(1e-11, help="Converged: standard deviations of x.", check=between(0.0))
    floor: float = setting(
        0.01, help="How far inside a --start on a bound begins.", check=between(1e-12, 0.499)
    )
    seed: int = setting(0, help="Governs every draw.", check=whole(0))

    def __post_init__(self) -> None:
        settle(self)
        # Of two fields at once, which the check of one cannot see.
        check_rank(self.rank, self.tied)


@dataclass(frozen=True, kw_only=True)
class RoutingCandidate(Candidate):
    """A vector, its recipe and its penalised score.

    Attributes:
        x: the vector, n numbers; of a start on the boundary the one nearby that the search begins at.
        origin: "equal" for x = 0, "start" for the recipe started from, "sample" for a draw, "average" for
            the mean of what k folds found.
        penalty: lambda times the mean entropy of the recipe's weights (eq. 13), and what ``shrinkage``
            takes for its distance from x = 0; in the score's unit.
        sigma: step size of the distribution it was drawn from (the initial one for generation 0).
        axes: standard deviations along that distribution's principal axes, ascending.
        fold: the split whose guiding images it is judged by and whose held-out images it may be chosen by;
            None where all validation pairs are one, as without a hold-out.
        reference: score of x = 0 on the images held out by ``fold``, less that on all images; 0 without.
    """

    x: tuple[float, ...]
    origin: str
    penalty: float
    sigma: float
    axes: tuple[float, ...]
    fold: int | None = None
    reference: float = 0.0

    @property
    def guiding(self) -> float:
        """Score on the images that guide the search; ``inf`` where the candidate failed."""
        return self.score if self.fold is None or self.failed else self.outcome.parts[self.fold].guiding

    @property
    def held(self) -> float | None:
        """Score on the images held out; None without a hold-out, ``inf`` where the candidate failed."""
        if self.fold is None:
            return None
        return math.inf if self.failed else self.outcome.parts[self.fold].held

    @property
    def fitness(self) -> float:
        """F(x) = score + penalty (eq. 13) on the guiding images, what the search minimises."""
        return self.guiding + self.penalty

    @property
    def criterion(self) -> float:
        """What the best is chosen by: held-out score + penalty, or F(x) without a hold-out.

        Folds hold out different images, some harder than others; ``reference`` takes that out.
        """
        return self.fitness if self.held is None else self.held - self.reference + self.penalty

    @property
    def rank(self) -> tuple[float, int]:
        """Sorts candidates, best first: by :attr:`criterion`, ties to the earlier one."""
        return (self.criterion, self.number)

    def as_record(self) -> dict[str, Any]:
        """Plain values for the history and the journal."""
        return {
            **super().as_record(),
            "origin": self.origin,
            "penalty": self.penalty,
            "penalised": self.fitness,
            "fold": self.fold,
            "guiding": self.guiding,
            "held": self.held,
            "criterion": self.criterion,
            "sigma": self.sigma,
            "weights": self.recipe.weights,
            "scales": self.recipe.scales,
        }


@dataclass(frozen=True)
class Distribution:
    """The normal distribution N(mean, sigma^2 C) that a population is drawn from.

    Attributes:
        mean: n numbers.
        sigma: step size.
        axes: sigma times the square roots of the eigenvalues of C, ascending: the standard deviations
            along the principal axes.
    """

    mean: tuple[float, ...]
    sigma: float
    axes: tuple[float, ...]


@dataclass(frozen=True)
class RoutingState(SearchState[RoutingCandidate]):
    """State of Stage 2.

    Attributes:
        distribution: what the last population was drawn from.
        stops: pycma's stop conditions that hold; none after a population that failed as a whole.
    """

    distribution: Distribution = field(default=Distribution((), 0.0, ()))
    stops: tuple[str, ...] = ()


def routing_history(
    candidates: Sequence[RoutingCandidate],
    sources: Sequence[str],
    blocks: Sequence[str],
    dimension: int,
    predicted: Sequence[str] = (),
) -> pd.DataFrame:
    """Table of a Stage 2 search.

    Columns: ``candidate`` (number of the evaluation, from 0: x = 0), ``generation`` (the iteration of
    CMA-ES; 0 is x = 0 and the start), ``subset``, ``size``, ``score`` (the benchmark's unit; inf where it
    failed), ``failed``, ``error``, ``cached``, ``repeated``, ``seconds``, ``cpu_seconds``, ``key`` as in
    Stage 1; ``origin`` ("equal", "start", "sample" or "average"), ``penalty`` (lambda times the mean entropy,
    eq. 13, and the shrinkage), ``fold`` (which split it belongs to; None without a hold-out), ``guiding`` and
    ``held`` (score on the pairs that guide the search and on those held out; None without), ``penalised``
    (guiding + penalty, what the search minimises), ``sigma`` (step size that it was sampled with),
    ``axis:<i>`` (standard deviations along the principal axes of that distribution, ascending),
    ``weight:<block>:<source>`` (routing weights), ``scale:<block>`` (module scales), and those of
    ``predicted``.
    """
    rows = [_routing_row(candidate) for candidate in candidates]
    axes = [f"axis:{i}" for i in range(dimension)]
    weights = [f"weight:{block}:{source}" for block in blocks for source in sources]
    scales = [f"scale:{block}" for block in blocks]
    own = ["origin", "penalty", "fold", "guiding", "held", "penalised", "sigma"]
    import pandas as pd

    return pd.DataFrame(rows, columns=[*COMMON, *ORIGIN, *own, *axes, *weights, *scales, *predicted])


def _routing_row(candidate: RoutingCandidate) -> dict[str, object]:
    recipe = candidate.recipe
    row: dict[str, object] = candidate.as_record()
    row |= {f"axis:{i}": length for i, length in enumerate(candidate.axes)}
    for block in recipe.blocks:
        weights, scale = recipe.of(block)
        row |= {f"weight:{block}:{source}": weight for source, weight in weights.items()}
        row[f"scale:{block}"] = scale
    return row
