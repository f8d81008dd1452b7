"""What Stage 2 leaves behind: its candidates, and its state between two generations."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from sfkit.search.base import SearchState
from sfkit.search.cma_es import Distribution
from sfkit.search.records import Candidate


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
class RoutingState(SearchState[RoutingCandidate]):
    """State of Stage 2.

    Attributes:
        distribution: what the last population was drawn from.
        stops: pycma's stop conditions that hold; none after a population that failed as a whole.
    """

    distribution: Distribution = field(default=Distribution((), 0.0, ()))
    stops: tuple[str, ...] = ()
