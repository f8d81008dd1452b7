"""Stage 2: architecture-adaptive routing by CMA-ES (StereoFactory, Algorithm 2).

How are the chosen sources mixed? CMA-ES moves routing logits and module scales; the equal-weight merge
that Stage 1 scored is x = 0 and is evaluated first, so that Stage 2 never returns worse than it got.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.base import Search, SearchState
from sfkit.search.checks import distinct_names
from sfkit.search.cma_es import CmaEs, Distribution, default_population, finite_fitness
from sfkit.search.constraints import Constraints
from sfkit.search.encoding import Encoding, Vector, mean_entropy
from sfkit.search.history import routing_history
from sfkit.search.journal import Journal
from sfkit.search.records import Candidate
from sfkit.search.routing_settings import RoutingSettings
from sfkit.search.scoring import hear


@dataclass(frozen=True, kw_only=True)
class RoutingCandidate(Candidate):
    """A vector, its recipe and its penalised score.

    Attributes:
        x: the vector, n numbers; of a start on the boundary the one nearby that the search begins at.
        origin: "equal" for x = 0, "start" for the recipe started from, "sample" for a draw.
        penalty: lambda times the mean entropy of the recipe's weights (eq. 13).
        sigma: step size of the distribution it was drawn from (the initial one for generation 0).
        axes: standard deviations along that distribution's principal axes, ascending.
    """

    x: tuple[float, ...]
    origin: str
    penalty: float
    sigma: float
    axes: tuple[float, ...]

    @property
    def fitness(self) -> float:
        """F(x) = score + penalty (eq. 13), what the search minimises; ``inf`` where the candidate failed."""
        return self.score + self.penalty

    def as_record(self) -> dict[str, Any]:
        """Plain values for the history and the journal."""
        return {
            **super().as_record(),
            "origin": self.origin,
            "penalty": self.penalty,
            "penalised": self.fitness,
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


class RoutingSearch(Search[RoutingCandidate]):
    """Stage 2 over the sources of a subset; see :class:`RoutingSettings` for the defaults.

    Generation 0 scores x = 0, and ``start`` where one is given; every further one is an iteration of
    CMA-ES. The optimiser's state is rebuilt from seed and scores whenever a step was interrupted.
    """

    kind: ClassVar[str] = "routing"

    def __init__(
        self,
        sources: Iterable[str],
        blocks: Iterable[str],
        scorer: Scorer,
        settings: RoutingSettings | None = None,
        *,
        constraints: Constraints | None = None,
        start: Recipe | None = None,
        journal: Journal | None = None,
    ) -> None:
        """Check everything; nothing is scored before the first step.

        Args:
            sources: names of the subset's sources, at least two.
            blocks: names of the blocks, in the partition's order.
            scorer: hears recipes, answers outcomes.
            settings: budget, step size and the like.
            constraints: frozen blocks, and limits the subset must meet.
            start: a recipe over these sources; it is scored right after x = 0, as it is, and the first
                mean of CMA-ES is its vector in place of 0.
            journal: where to write what happens, for viewers.

        Raises:
            InputError: fewer than two sources, an unknown or repeated name, a subset or a start that
                breaks the constraints.
        """
        super().__init__(scorer, journal)
        self.sources = distinct_names("sources", sources)
        self.blocks = distinct_names("blocks", blocks)
        self.settings = settings or RoutingSettings()
        self.constraints = constraints or Constraints()
        if not self.blocks:
            raise InputError("blocks: found none, expected the names of at least one block")
        self.constraints.check_subset(self.sources, self.blocks)
        self.encoding = Encoding(
            self.sources,
            self.blocks,
            (float(self.settings.gamma[0]), float(self.settings.gamma[1])),
            self.settings.tied,
            self.settings.scaled,
            self.constraints.frozen_blocks,
        )
        self.start = None if start is None else self.encoding.admit(start)
        self._cma: CmaEs | None = None
        self._state = RoutingState()

    @property
    def population(self) -> int:
        """Candidates in one iteration of CMA-ES."""
        return int(self.settings.population or default_population(self.encoding.dimension))

    @property
    def state(self) -> RoutingState:
        """The current state; frozen."""
        return self._state

    @property
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""
        if len(self._state.candidates) >= self.settings.evaluations:
            return f"the budget of {self.settings.evaluations} evaluations is used up"
        if self.settings.converge and self._state.stops:
            return f"CMA-ES has converged ({', '.join(self._state.stops)})"
        return None

    @property
    def history(self) -> pd.DataFrame:
        """One row a candidate; the columns are described at :func:`sfkit.search.history.routing_history`."""
        return routing_history(self._state.candidates, self.sources, self.blocks, self.encoding.dimension)

    def _advance(self) -> None:
        state = self._state
        cma = self._cma or self._replayed()
        # Dropped until the step is over: one that is interrupted half-way is rebuilt from the state.
        self._cma = None
        generation = state.generation + 1
        if generation == 0:
            vectors, origins, recipes = self._first()
        else:
            vectors = list(cma.ask())
            origins = ["sample"] * len(vectors)
            recipes = [self.encoding.decode(x) for x in vectors]
        left = int(self.settings.evaluations) - len(state.candidates)
        fresh = self._scored(vectors[:left], origins[:left], recipes[:left], cma.distribution, generation)
        candidates = (*state.candidates, *fresh)
        if generation > 0 and len(fresh) == len(vectors):
            cma.tell(_values(fresh, candidates))
        # Values made up for failures can look like convergence, which must not end the run.
        stops = () if all(candidate.failed for candidate in fresh) else cma.stops
        self._state = RoutingState(generation, candidates, cma.distribution, stops)
        self._cma = cma

    def _first(self) -> tuple[list[Vector], list[str], list[Recipe]]:
        zero = np.zeros(self.encoding.dimension)
        equal = self.encoding.decode(zero)
        if self.start is None:
            return [zero], ["equal"], [equal]
        return [zero, self._mean()], ["equal", "start"], [equal, self.start]

    def _mean(self) -> Vector:
        if self.start is None:
            return np.zeros(self.encoding.dimension)
        return self.encoding.encode(self.start, float(self.settings.floor))

    def _replayed(self) -> CmaEs:
        """The optimiser after the state's generations, from the seed and the scores alone."""
        settings, state = self.settings, self._state
        cma = CmaEs(
            self._mean(),
            float(settings.sigma),
            self.population,
            int(settings.seed),
            tolfun=float(settings.tolfun),
            tolx=float(settings.tolx),
        )
        for generation in range(1, state.generation + 1):
            told = [candidate for candidate in state.candidates if candidate.generation == generation]
            cma.ask()
            cma.tell(_values(told, state.candidates[: told[-1].number + 1]))
        return cma

    def _scored(
        self,
        vectors: Sequence[Vector],
        origins: Sequence[str],
        recipes: Sequence[Recipe],
        distribution: Distribution,
        generation: int,
    ) -> tuple[RoutingCandidate, ...]:
        past = self._state.candidates
        heard = hear(past, recipes, self._scorer)
        return tuple(
            RoutingCandidate(
                number=len(past) + i,
                generation=generation,
                recipe=recipe,
                outcome=answer.outcome,
                repeated=answer.repeated,
                x=tuple(float(entry) for entry in x),
                origin=origin,
                penalty=float(self.settings.entropy) * mean_entropy(recipe),
                sigma=distribution.sigma,
                axes=distribution.axes,
            )
            for i, (x, origin, recipe, answer) in enumerate(
                zip(vectors, origins, recipes, heard, strict=True)
            )
        )

    def _description(self) -> dict[str, Any]:
        return {
            "sources": self.sources,
            "blocks": self.blocks,
            "settings": self.settings,
            "constraints": self.constraints,
            "start": None if self.start is None else self.start.as_dict(),
            "dimension": self.encoding.dimension,
            "population": self.population,
        }

    def _details(self) -> dict[str, Any]:
        return {"distribution": self._state.distribution, "stops": self._state.stops}


def _values(told: Sequence[RoutingCandidate], so_far: Sequence[RoutingCandidate]) -> list[float]:
    worst = max((c.fitness for c in so_far if math.isfinite(c.fitness)), default=0.0)
    return finite_fitness([candidate.fitness for candidate in told], worst)
