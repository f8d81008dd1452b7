"""Stage 2 by Bayesian optimisation: a model of the score over weights and scales proposes what to score.

What Stage 1 evaluated of these sources is of the same space, all scales 1, so that the model knows something
before the first evaluation of Stage 2. Where every block has weights of its own it sees a block by the
coefficients of its task vectors, scale times weight, with a length scale a block. Tied weights it sees so, or
weights and scales apart, each scale with a length scale of its own: whichever explains the scores better, by
the evidence. Scores worse than that of x = 0 are drawn together logarithmically: how bad they are says little
of where the best is. Proposals come from a trust region around the best so far that grows while it finds
something and shrinks while it does not (Eriksson et al. 2019, TuRBO); one that is too small begins again at
its first size, the model keeping all it knows. Every second proposal, without tied weights every third, is
bold, of draws near and far around the best: a region alone stays where CMA-ES finds scales far from 1.

Measured with tied routing over two to five sources (``benchmarks/stage2.py``): for what CMA-ES has after 300
evaluations the model needs 38 at the median of twelve searches on the bank, of which eight get there within
44 and four not with 100, two of these 1.0 and 1.6 points behind; and 39 at the median of four searches on the
real AnyNet pool, all within 47.

How tied weights are seen, and how often a proposal is bold, was chosen by ten searches that are none of
these: six on the real pool, on windows of 96 x 256 px elsewhere in its pairs, four on the bank. Evaluations
for what CMA-ES has after 300, at the median, and searches that need at most 80: 72, four of six on the real
pool, 43, three of four on the bank. By weights and scales apart alone 70, four of six, and 62, three of four;
nine of the bank's reported searches had been run so before, of which three got there, and that is why it is
not alone. Tried on the real pool and not kept: by coefficients alone with every third proposal bold, as
before, one of six; with every second one of four; with none bold none of four; handed over to CMA-ES after
40, one of four; bounds half as far below the mean, of many more draws, none of four.

Tried before on ten other draws of the bank's pairs; points behind CMA-ES after 60 evaluations. Weights and
all scales in two groups, of all Stage 1 scored, unbent: 0.55 at the median of five, 0.04 by coefficients. No
region, but draws near and far by three bounds in turn: 0.55 at the mean of six, 0.10 with it. A region that
begins at 0.7, with more patience: 0.56. Draws around x = 0 at any proposal find a narrow deep valley of a
made-up landscape within 30 evaluations; bold proposals do not within 50. On the bank those draws took 89
evaluations at the median.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.bayesian_settings import BayesianRoutingSettings
from sfkit.search.constraints import Constraints
from sfkit.search.encoding import Vector
from sfkit.search.gaussian_process import Array, Points
from sfkit.search.journal import Journal
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import Distribution, RoutingCandidate, RoutingState
from sfkit.search.surrogate import (
    PREDICTED,
    Prediction,
    Proposed,
    Surrogate,
    known_records,
    learned,
    routing_features,
    routing_points,
    routing_views,
)
from sfkit.streams import Stream, generator

_DRAWN = 256
_CLOSER = 3.0
"""Each further round of draws is around the best so far, in a radius so many times smaller."""
_NEAREST = 0.05
_BOLD = {True: 2, False: 3}
"""Tied or not -> every so many candidates one is proposed boldly, as measured, whatever the region."""
PROPOSALS = 3
"""Which rule proposes; raised where the same settings come to propose other candidates."""
_REFIT = 3
"""Candidates after which length scales and noise are fitted anew."""


@dataclass(frozen=True, kw_only=True)
class ProposedRouting(Proposed, RoutingCandidate):
    """A vector, its recipe, and what the model said of it before."""


class BayesianRoutingSearch(RoutingSearch):
    """Stage 2 over the sources of a subset by a model; see :class:`BayesianRoutingSettings`.

    Generation 0 scores x = 0, and ``start`` where one is given; every further one is a batch of proposals.
    Generation t draws from ``generator(seed, Stream.BAYESIAN_ROUTING, t)`` alone.
    """

    settings: BayesianRoutingSettings
    predicted = PREDICTED

    def __init__(
        self,
        sources: Iterable[str],
        blocks: Iterable[str],
        scorer: Scorer,
        settings: BayesianRoutingSettings | None = None,
        *,
        constraints: Constraints | None = None,
        start: Recipe | None = None,
        known: Iterable[Known] = (),
        journal: Journal | None = None,
    ) -> None:
        """Check everything; nothing is scored before the first step.

        Args:
            sources: names of the subset's sources, at least two.
            blocks: names of the blocks, in the partition's order.
            scorer: takes recipes, returns outcomes.
            settings: budget, trust region and the like.
            constraints: frozen blocks, and limits the subset must meet.
            start: a recipe over these sources, scored right after x = 0.
            known: what was scored before, such as by Stage 1; the model sees those of these sources alone.
            journal: where to write what happens, for viewers.

        Raises:
            InputError: as :class:`~sfkit.search.routing.RoutingSearch`.
        """
        super().__init__(
            sources,
            blocks,
            scorer,
            settings or BayesianRoutingSettings(),
            constraints=constraints,
            start=start,
            journal=journal,
        )
        # Merges of other sources say little of how these are mixed, and their bad scores spoil the fit.
        self.known = tuple(entry for entry in known if set(entry.recipe.sources) <= set(self.sources))
        self._views = routing_views(len(self.blocks), tied=self.encoding.tied)
        self._seen = self._features(entry.recipe for entry in self.known)
        self._own = self._features(())
        self._fitted: tuple[int, Surrogate] | None = None

    @property
    def population(self) -> int:
        """Candidates in one generation."""
        return self.settings.batch

    @property
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""
        over = len(self._state.candidates) >= self.settings.evaluations
        return f"the budget of {self.settings.evaluations} evaluations is used up" if over else None

    def _advance(self) -> None:
        state = self._state
        generation = state.generation + 1
        left = self.settings.evaluations - len(state.candidates)
        told: list[Prediction | None]
        region = self._region()
        if generation == 0:
            vectors, origins, recipes = self._first()
            told = [None] * len(vectors)
        else:
            rng = generator(self.settings.seed, Stream.BAYESIAN_ROUTING, generation)
            vectors, told = self._proposed(region, rng, min(self.population, left))
            origins = ["sample"] * len(vectors)
            recipes = [self.encoding.decode(x) for x in vectors]
        scored = self._scored(vectors[:left], origins[:left], recipes[:left], region, generation)
        fresh = tuple(
            ProposedRouting(**vars(candidate), prediction=prediction)
            for candidate, prediction in zip(scored, told, strict=False)
        )
        self._state = RoutingState(generation, (*state.candidates, *fresh), region)

    def _bold(self, number: int) -> bool:
        """Whether the candidate of this number is proposed whatever the region."""
        every = _BOLD[self.encoding.tied]
        return self.settings.far > 0.0 and number % every == every - 1

    def _region(self) -> Distribution:
        """The trust region: around the best, as wide as the course of the search says."""
        best, radius = self.best, self.settings.sigma
        lowest, good, bad = math.inf, 0, 0
        for candidate in self._state.candidates:
            # A failed one is infinite, and so never a gain.
            better = candidate.fitness < lowest
            lowest = min(lowest, candidate.fitness)
            # Not drawn in the region: these say nothing of how wide it should be.
            if candidate.origin != "sample" or self._bold(candidate.number):
                continue
            good, bad = (good + 1, 0) if better else (0, bad + 1)
            if 2 * good >= self.settings.patience:
                radius, good = min(2.0 * radius, 4.0 * self.settings.sigma), 0
            elif bad >= self.settings.patience:
                radius, bad = radius / 2.0, 0
            # Draws hardly differ any more: it begins anew around the best.
            if radius < self.settings.smallest:
                radius = self.settings.sigma
        centre = tuple(self._mean()) if best is None else best.x
        return Distribution(tuple(float(m) for m in centre), radius, (radius,) * self.encoding.dimension)

    def _proposed(
        self, region: Distribution, rng: np.random.Generator, count: int
    ) -> tuple[list[Vector], list[Prediction | None]]:
        """The next batch: each has the smallest bound, by a model that believes in those before it."""
        model = self._model()
        centre = np.array(region.mean)
        vectors: list[Vector] = []
        told: list[Prediction | None] = []
        for number in range(len(self._state.candidates), len(self._state.candidates) + count):
            if model is None:
                # Nothing to learn from yet.
                x, prediction = centre + region.sigma * rng.standard_normal(centre.size), None
            else:
                if vectors:
                    # The kriging believer: what was just proposed counts as scored, at the mean.
                    model = model.believing(self._points(vectors[-1][None, :]))
                x, prediction = self._acquired(model, region, rng, bold=self._bold(number))
            vectors.append(x)
            told.append(prediction)
        return vectors, told

    def _acquired(
        self, model: Surrogate, region: Distribution, rng: np.random.Generator, *, bold: bool
    ) -> tuple[Vector, Prediction]:
        """The smallest bound among draws in the region, or far and near, then nearer and nearer around it."""
        around, found = np.array(region.mean), (math.inf, math.inf, math.inf)
        # A bold proposal explores, one inside the region refines.
        beta = self.settings.beta / (1.0 if bold else 2.0)
        radii = [np.array(region.sigma) / _CLOSER**n for n in range(3)]
        if bold:
            far = self.settings.far
            # Even in the logarithm, so that near and far are looked at alike.
            ends = (math.log(min(_NEAREST, far)), math.log(far))
            radii = [
                np.exp(rng.uniform(*ends, (2 * _DRAWN, 1))),
                *(np.array(_CLOSER**-n) for n in (1, 2, 3)),
            ]
        chosen = around
        for turn, radius in enumerate(radii):
            count = radius.size if radius.ndim else _DRAWN
            draws = chosen + radius * rng.standard_normal((count, around.size))
            if turn == 0:  # some move along a few axes alone
                draws = np.where(rng.random(draws.shape) < rng.random((count, 1)), draws, around)
            mean, sd, bound = model.bounds(self._points(draws), beta)
            bound = bound + self._penalties(draws)
            first = int(np.argmin(bound))
            if bound[first] < found[2]:
                chosen, found = draws[first], (float(mean[first]), float(sd[first]), float(bound[first]))
        return chosen, Prediction(*found)

    def _model(self) -> Surrogate | None:
        """What this search's candidates and everything scored before tell; None where nothing has a score.

        Length scales and noise are those of the last count of candidates that ``_REFIT`` divides: a search
        that was interrupted since finds the same.
        """
        own = [candidate for candidate in self._state.candidates if not candidate.repeated]
        # Of the new ones alone: no candidate is ever taken back, so that features of those before stay.
        more = self._features(c.recipe for c in own[len(self._own[0]) :])
        self._own = tuple(np.concatenate(groups) for groups in zip(self._own, more, strict=True))
        points, scores = self._learned_from(own)
        if len(scores) < 2 or not np.isfinite(scores).any():
            return None
        # At fixed numbers of candidates: a search that goes on after a kill fits the same models.
        count = len(own) if len(own) < _REFIT else len(own) - len(own) % _REFIT
        if self._fitted is None or self._fitted[0] != count:
            before, known = self._learned_from(own[:count])
            if len(known) < 2 or not np.isfinite(known).any():
                return learned(points, scores, knee=own[0].score, views=self._views)
            self._fitted = count, learned(before, known, knee=own[0].score, views=self._views)
        return learned(points, scores, knee=own[0].score, like=self._fitted[1])

    def _learned_from(self, own: Sequence[RoutingCandidate]) -> tuple[Points, Array]:
        """Features and scores of these candidates, and of what else is known."""
        met = {candidate.recipe for candidate in own}
        others = [n for n, entry in enumerate(self.known) if entry.recipe not in met]
        scores = np.array([*(c.score for c in own), *(self.known[n].score for n in others)])
        groups = zip(self._own, self._seen, strict=True)
        return tuple(np.concatenate([a[: len(own)], b[others]]) for a, b in groups), scores

    def _features(self, recipes: Iterable[Recipe]) -> Points:
        """What the model sees of recipes."""
        return routing_features(recipes, self.sources, self.blocks, tied=self.encoding.tied)

    def _points(self, draws: Array) -> Points:
        """Features of the recipes that rows of ``draws``, (m, dimension), stand for."""
        return routing_points(*self._rows_and_scales(draws), tied=self.encoding.tied)

    def _rows_and_scales(self, draws: Array) -> tuple[Array, Array]:
        """Weights (m, B, E) and scales (m, B) that rows of ``draws``, (m, dimension), stand for."""
        encoding, count = self.encoding, len(self.sources)
        logits = encoding.logits(draws)
        # As softmax does it for one recipe: the largest power is 1, so that none overflows.
        powers = np.exp(logits - logits.max(axis=2, keepdims=True))
        rows = np.full((len(draws), len(self.blocks), count), 1.0 / count)
        scales = np.ones((len(draws), len(self.blocks)))
        free = [self.blocks.index(block) for block in encoding.free]
        # A tied row serves frozen blocks as well; what is frozen there is the scale.
        moved = slice(None) if encoding.tied else free
        rows[:, moved] = powers / powers.sum(axis=2, keepdims=True)
        if encoding.scaled:
            # As scale_of (eq. 11), for all draws at once.
            half = (encoding.gamma[1] - encoding.gamma[0]) / 2.0
            scales[:, free] = 1.0 + half * np.tanh(draws[:, -len(free) :] / 2.0)
        return rows, scales

    def _penalties(self, draws: Array) -> Array:
        """What F(x) adds to the score of each vector (eq. 13, and the shrinkage)."""
        # Spares decoding hundreds of draws where nothing would be added.
        if self.settings.entropy == 0 and self.settings.shrinkage == 0:
            return np.zeros(len(draws))
        zero = self._state.candidates[0].outcome
        return np.array([self._penalty(x, self.encoding.decode(x), zero) for x in draws])

    def _description(self) -> dict[str, Any]:
        return {**super()._description(), "method": "bayesian", "known": known_records(self.known)}
