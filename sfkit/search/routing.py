"""Stage 2: architecture-adaptive routing by CMA-ES (StereoFactory, Algorithm 2).

How are the chosen sources mixed? CMA-ES moves routing logits and module scales; the equal-weight merge
that Stage 1 scored is x = 0 and is evaluated first, so that Stage 2 never returns worse than it got, on
the score it selects by. With a hold-out that is the score on pairs that did not guide CMA-ES.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.holdout import held_out, splits_of
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.base import Search
from sfkit.search.checks import distinct_names
from sfkit.search.cma_es import CmaEs, default_population, finite_fitness
from sfkit.search.constraints import Constraints
from sfkit.search.encoding import Vector, encoding_of, mean_entropy
from sfkit.search.journal import Journal
from sfkit.search.routing_records import (
    Distribution,
    RoutingCandidate,
    RoutingSettings,
    RoutingState,
    routing_history,
)
from sfkit.search.scoring import score_once


class RoutingSearch(Search[RoutingCandidate]):
    """Stage 2 over the sources of a subset; see :class:`RoutingSettings` for the defaults.

    Generation 0 scores x = 0, and ``start`` where one is given; every further one is an iteration of
    CMA-ES. The optimiser's state is rebuilt from seed and scores whenever a step was interrupted.

    With k folds there are k optimisers that take turns, each guided by all pairs but those of its fold.
    The last evaluation is that of the mean of what each found best on its own fold: moves that only some
    of the folds ask for are damped by it.
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
            scorer: takes recipes, returns outcomes; for a hold-out an evaluator, or several combined.
            settings: budget, step size and the like.
            constraints: frozen blocks, and limits the subset must meet.
            start: a recipe over these sources; it is scored right after x = 0, as it is, and the first
                mean of CMA-ES is its vector in place of 0.
            journal: where to write what happens, for viewers.

        Raises:
            InputError: fewer than two sources, an unknown or repeated name, a subset or a start that
                breaks the constraints, or a hold-out of a scorer that does not know its images.
        """
        self.settings = settings or RoutingSettings()
        super().__init__(held_out(scorer, self.settings.holdout, self.settings.seed), journal)
        self.folds = splits_of(self._scorer)
        self.sources = distinct_names("sources", sources)
        self.blocks = distinct_names("blocks", blocks)
        self.constraints = constraints or Constraints()
        if not self.blocks:
            raise InputError("blocks: found none, expected the names of at least one block")
        self.encoding = encoding_of(self.sources, self.blocks, self.settings, self.constraints)
        self.start = None if start is None else self.encoding.admit(start)
        self._cmas: list[CmaEs] | None = None
        self._state = RoutingState()

    @property
    def population(self) -> int:
        """Candidates in one iteration of CMA-ES."""
        return self.settings.population or default_population(self.encoding.dimension)

    @property
    def state(self) -> RoutingState:
        """The current state; frozen."""
        return self._state

    @property
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""
        if len(self._state.candidates) >= self.settings.evaluations:
            return f"the budget of {self.settings.evaluations} evaluations is used up"
        # Folds take turns: one optimiser that converged says nothing of the others.
        if self.settings.converge and self._state.stops and self.folds < 2:
            return f"CMA-ES has converged ({', '.join(self._state.stops)})"
        return None

    @property
    def history(self) -> pd.DataFrame:
        """One row a candidate; columns as at :func:`sfkit.search.routing_records.routing_history`."""
        names = (self.sources, self.blocks, self.encoding.dimension)
        return routing_history(self._state.candidates, *names, self.predicted)

    @property
    def best(self) -> RoutingCandidate | None:
        """The best candidate so far by its criterion, the earlier one of a tie; None where there is none.

        Once the folds' average is scored, it or what the search began with, whichever is better on all
        validation pairs.
        """
        if not any(candidate.origin == "average" for candidate in self.candidates):
            return super().best
        whole = [candidate for candidate in self.candidates if candidate.fold is None]
        return min((c for c in whole if not c.failed), key=lambda c: c.rank, default=None)

    def _advance(self) -> None:
        state = self._state
        cmas = self._cmas or self._replayed()
        # Dropped until the step is over: one that is interrupted half-way is rebuilt from the state.
        self._cmas = None
        generation = state.generation + 1
        left = self.settings.evaluations - len(state.candidates)
        turn = self._turn(generation)
        cma = cmas[turn]
        if generation == 0:
            vectors, origins, recipes = self._first()
        elif self.folds > 1 and left == 1:
            vectors, origins = [self._average()], ["average"]
            recipes = [self.encoding.decode(vectors[0])]
        else:
            vectors = list(cma.ask())
            origins = ["sample"] * len(vectors)
            recipes = [self.encoding.decode(x) for x in vectors]
            left -= self.folds > 1  # the last one is the average's
        fresh = self._scored(vectors[:left], origins[:left], recipes[:left], cma.distribution, generation)
        candidates = (*state.candidates, *fresh)
        # A population that the budget cut is not told: CMA-ES wants a value for each vector it gave.
        if origins[0] == "sample" and len(fresh) == len(vectors):
            cma.tell(_values(fresh, candidates))
        # Values made up for failures can look like convergence, which must not end the run.
        stops = () if all(candidate.failed for candidate in fresh) else cma.stops
        self._state = RoutingState(generation, candidates, cma.distribution, stops)
        self._cmas = cmas

    def _turn(self, generation: int) -> int:
        """Whose turn it is among the folds' optimisers; there is one without folds."""
        # Generation 0 is x = 0, which belongs to no fold.
        return max(generation - 1, 0) % max(self.folds, 1)

    def _average(self) -> Vector:
        """The mean of the folds' best vectors; a fold that found nothing better gives x = 0."""
        equal = self.candidates[0]
        winners = []
        for fold in range(self.folds):
            # x = 0 competes in every fold, so that a fold that found nothing pulls the mean back to it.
            found = [c for c in self.candidates if c.fold == fold and not c.failed]
            winners.append(np.array(min([equal, *found], key=lambda c: c.rank).x))
        return np.asarray(np.mean(winners, axis=0))

    def _first(self) -> tuple[list[Vector], list[str], list[Recipe]]:
        zero = np.zeros(self.encoding.dimension)
        equal = self.encoding.decode(zero)
        if self.start is None:
            return [zero], ["equal"], [equal]
        return [zero, self._mean()], ["equal", "start"], [equal, self.start]

    def _mean(self) -> Vector:
        if self.start is None:
            return np.zeros(self.encoding.dimension)
        return self.encoding.encode(self.start, self.settings.floor)

    def _replayed(self) -> list[CmaEs]:
        """The optimisers after the state's generations, from the seed and the scores alone."""
        settings, state = self.settings, self._state
        cmas = [
            CmaEs(
                self._mean(),
                settings.sigma,
                self.population,
                settings.seed,
                tolfun=settings.tolfun,
                tolx=settings.tolx,
                island=island,
            )
            for island in range(max(self.folds, 1))
        ]
        for generation in range(1, state.generation + 1):
            told = [candidate for candidate in state.candidates if candidate.generation == generation]
            cma = cmas[self._turn(generation)]
            # Asked though the answer is known: the draws move the optimiser on as they did then.
            cma.ask()
            if len(told) == self.population:  # one that the budget cut was never told
                cma.tell(_values(told, state.candidates[: told[-1].number + 1]))
        return cmas

    def _scored(
        self,
        vectors: Sequence[Vector],
        origins: Sequence[str],
        recipes: Sequence[Recipe],
        distribution: Distribution,
        generation: int,
    ) -> tuple[RoutingCandidate, ...]:
        past = self._state.candidates
        found = score_once(past, recipes, self._scorer)
        # Candidate 0 is x = 0 in every search.
        zero = past[0].outcome if past else found[0].outcome
        turn = self._turn(generation)
        return tuple(
            RoutingCandidate(
                number=len(past) + i,
                generation=generation,
                recipe=recipe,
                outcome=answer.outcome,
                repeated=answer.repeated,
                x=tuple(float(entry) for entry in x),
                origin=origin,
                penalty=self._penalty(x, recipe, zero),
                sigma=distribution.sigma,
                axes=distribution.axes,
                # With several folds x = 0, a start and the average belong to none.
                fold=turn if self.folds == 1 or (self.folds and origin == "sample") else None,
                # Folds hold out different pairs, of different difficulty: less what x = 0 has there, they
                # compare.
                reference=zero.parts[turn].held - zero.score if self.folds > 1 and zero.parts else 0.0,
            )
            for i, (x, origin, recipe, answer) in enumerate(
                zip(vectors, origins, recipes, found, strict=True)
            )
        )

    def _penalty(self, x: Vector, recipe: Recipe, zero: Outcome) -> float:
        entropy = self.settings.entropy * mean_entropy(recipe)
        # In shares of x = 0's score: one weight then suits every metric and benchmark.
        at_zero = 0.0 if zero.failed or not math.isfinite(zero.score) else zero.score
        return entropy + self.settings.shrinkage * at_zero * self.encoding.distance(x)

    def _description(self) -> dict[str, Any]:
        return {
            "sources": self.sources,
            "blocks": self.blocks,
            "settings": self.settings,
            "constraints": self.constraints,
            "start": None if self.start is None else self.start.as_dict(),
            "dimension": self.encoding.dimension,
            "population": self.population,
            "folds": self.folds,
        }

    def _details(self) -> dict[str, Any]:
        return {"distribution": self._state.distribution, "stops": self._state.stops}


def _values(told: Sequence[RoutingCandidate], so_far: Sequence[RoutingCandidate]) -> list[float]:
    # Of the whole search: a population that failed altogether still gets values in the range of the scores.
    worst = max((c.fitness for c in so_far if math.isfinite(c.fitness)), default=0.0)
    return finite_fitness([candidate.fitness for candidate in told], worst)
