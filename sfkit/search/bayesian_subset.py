"""Stage 1 by Bayesian optimisation: a model of the score proposes which subsets to score next.

A merge is a smooth function of its weights, so that a Gaussian process over them knows after a few dozen
evaluations where the good subsets are. What is proposed next has the smallest lower confidence bound
(GP-UCB, Srinivas et al. 2010), several at a time by believing the model's own mean for those before (GP-BUCB,
Desautels et al. 2014). Expected improvement over the best score so far (EGO, Jones et al. 1998) in its place
needed as many evaluations at the median of 200 seeds on both landscapes that are known in full, 29 on 20
pairs and 26 on 8. On the latter, whose scores are noisier, it had found the best within 60 in 93 % of them,
the bound in 96.5 %; at most it needed 90, the bound 106 (``benchmarks/optimum.py``). Thompson sampling, where
each of a batch is the best of one joint draw of the posterior, needed more in every batch tried, over 40
seeds: 44, 52 and 88 evaluations at the median in batches of 4, 16 and 64 where believing needed 32, 38 and 84
(20 pairs; ``benchmarks/sections/thompson.py``).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.acquisition import equal_weights, smallest_bound, unmet
from sfkit.search.bayesian_settings import BayesianSubsetSettings
from sfkit.search.breeding import Draft
from sfkit.search.checks import require_known
from sfkit.search.constraints import Constraints, subset_of
from sfkit.search.gaussian_process import Array, Points
from sfkit.search.journal import Journal
from sfkit.search.operators import SMALLEST, Chromosome, random_chromosome
from sfkit.search.records import SubsetCandidate
from sfkit.search.subset import SubsetSearch, SubsetState
from sfkit.search.surrogate import (
    PREDICTED,
    Prediction,
    Proposed,
    Surrogate,
    features,
    known_records,
    learned,
    recipe_features,
)
from sfkit.streams import Stream, generator

_TRIES = 1000


@dataclass(frozen=True, kw_only=True)
class ProposedSubset(Proposed, SubsetCandidate):
    """A subset, and what the model said of it before."""


class BayesianSubsetSearch(SubsetSearch):
    """Stage 1 over named sources by a model of the score; see :class:`BayesianSubsetSettings`.

    Generation 0 scores every source alone, takes up what is known already, at no cost where the scorer has
    it in its store, and scores random subsets where that is less than ``population``. Every further
    generation proposes ``batch`` subsets nobody has scored. Generation t draws from
    ``generator(seed, Stream.BAYESIAN_SUBSETS, t)`` alone.
    """

    settings: BayesianSubsetSettings
    predicted = PREDICTED

    def __init__(
        self,
        sources: Iterable[str],
        blocks: Iterable[str],
        scorer: Scorer,
        settings: BayesianSubsetSettings | None = None,
        *,
        constraints: Constraints | None = None,
        start: Recipe | Iterable[Recipe | Iterable[str]] = (),
        known: Iterable[Known] = (),
        journal: Journal | None = None,
    ) -> None:
        """Check everything; nothing is scored before the first step.

        Args:
            sources: names of the pool's sources, at least two.
            blocks: names of the blocks, in the partition's order.
            scorer: takes recipes, returns outcomes.
            settings: sizes and the like.
            constraints: which subsets may be proposed.
            start: recipes or subsets scored first.
            known: what was scored before. Equal merges of subsets that may be proposed become candidates
                of generation 0, all others are seen by the model alone.
            journal: where to write what happens, for viewers.

        Raises:
            InputError: as :class:`~sfkit.search.subset.SubsetSearch`; or a known recipe of other sources
                or blocks.
        """
        super().__init__(
            sources,
            blocks,
            scorer,
            settings or BayesianSubsetSettings(),
            constraints=constraints,
            start=start,
            journal=journal,
        )
        self.known = tuple(known)
        for entry in self.known:
            require_known("known", entry.recipe.sources, self.sources, "source")
            require_known("known", self.blocks, entry.recipe.blocks, "block")
        alone = {self.recipe((gene,)) for gene in self._alone}
        # Those that become candidates are left out: the model would count them twice.
        self._others = tuple(
            entry
            for entry in self.known
            if entry.recipe not in alone and self._chromosome(entry.recipe) is None
        )

    @property
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""
        if self._left == 0:
            return f"all {self.space.subsets} subsets are scored"
        return super().reason

    @property
    def initial(self) -> int:
        """Candidates of generation 0."""
        return len(self._first(self._rng(0))[0])

    @property
    def best(self) -> SubsetCandidate | None:
        """The best subset so far, the earlier one of a tie; None where nothing has a finite score."""
        return next(iter(self.archive(1)), None)

    def archive(self, size: int | None = None) -> tuple[SubsetCandidate, ...]:
        """The best different subsets of two sources or more, best first."""
        return tuple(c for c in super().archive() if len(c.subset) >= SMALLEST)[:size]

    def _advance(self) -> None:
        state = self._state
        generation = state.generation + 1
        rng = self._rng(generation)
        drafts, told = self._first(rng) if generation == 0 else self._proposed(rng)
        fresh = tuple(
            ProposedSubset(**vars(candidate), prediction=prediction)
            for candidate, prediction in zip(self._scored(drafts, generation), told, strict=True)
        )
        candidates = (*state.candidates, *fresh)
        # A source alone teaches the model and wins nothing.
        subsets = [c for c in candidates if not c.repeated and len(c.subset) >= SMALLEST]
        best = sorted(subsets, key=lambda c: c.rank)
        population = tuple(c.number for c in best[: self.settings.population])
        self._state = SubsetState(generation, candidates, (*state.populations, population))

    def _rng(self, generation: int) -> np.random.Generator:
        return generator(self.settings.seed, Stream.BAYESIAN_SUBSETS, generation)

    def _first(self, rng: np.random.Generator) -> tuple[list[Draft], list[Prediction | None]]:
        """Starts, what is known, all sources together, then random subsets, each once."""
        # By sorted genes: to a model a chromosome is a set, in whatever order a start gives it.
        drafts = {tuple(sorted(c)): Draft(c, (), ("start",)) for c in self._starts}
        for entry in self.known:
            if (chromosome := self._chromosome(entry.recipe)) is not None:
                drafts.setdefault(chromosome, Draft(chromosome, (), ("known",)))
        # A small space has fewer subsets than a population asks for, and draws of new ones would never end.
        wanted = min(self.settings.population, self.space.subsets)
        everything = self.space.allowed
        if len(drafts) < wanted and self.space.holds(everything):
            drafts.setdefault(everything, Draft(everything, (), ("all",)))
        while len(drafts) < wanted:
            drawn = self._unmet(drafts, rng)
            drafts[drawn] = Draft(drawn, (), ("random",))
        first = [*(Draft((gene,), (), ("single",)) for gene in self._alone), *drafts.values()]
        return first, [None] * len(first)

    @property
    def _alone(self) -> Chromosome:
        """Sources that are scored alone."""
        return self.space.allowed if self.settings.singles else ()

    def _proposed(self, rng: np.random.Generator) -> tuple[list[Draft], list[Prediction | None]]:
        """The next batch: each minimises the bound of a model that believes in those before it."""
        model = self._model()
        met = {self._genes(candidate) for candidate in self._state.candidates}
        drafts: list[Draft] = []
        told: list[Prediction | None] = []
        for _ in range(min(self.settings.batch, self._left)):
            if model is None:  # nothing has a finite score yet
                chromosome, prediction = self._unmet(met, rng), None
            else:
                # The kriging believer, as in Stage 2.
                if drafts:
                    before = equal_weights([drafts[-1].chromosome], len(self.sources))
                    model = model.believing(self._points(before))
                chromosome, prediction = self._acquired(model, met, rng)
            drafts.append(Draft(chromosome, (), ("random" if prediction is None else "model",)))
            told.append(prediction)
            # The next of the batch is then another subset.
            met.add(chromosome)
        return drafts, told

    def _acquired(
        self, model: Surrogate, met: set[Chromosome], rng: np.random.Generator
    ) -> tuple[Chromosome, Prediction]:
        beta = self.settings.beta

        def bound(weights: Array) -> Array:
            return model.bounds(self._points(weights), beta)[2]

        best = [self._genes(self._state.candidates[number]) for number in self._state.populations[-1]]
        chromosome = smallest_bound(bound, self.space, len(self.sources), met, best, rng)
        weights = equal_weights([chromosome], len(self.sources))
        mean, sd, lowest = (float(value[0]) for value in model.bounds(self._points(weights), beta))
        return chromosome, Prediction(mean, sd, lowest)

    def _model(self) -> Surrogate | None:
        """What this search's candidates and everything scored before tell; None where nothing has a score."""
        # A repeated one is a point the model has already.
        own = [candidate for candidate in self._state.candidates if not candidate.repeated]
        scores = np.array([*(c.score for c in own), *(entry.score for entry in self._others)])
        if len(scores) < 2 or not np.isfinite(scores).any():
            return None
        subsets = self._points(equal_weights([self._genes(c) for c in own], len(self.sources)))
        recipes = recipe_features((entry.recipe for entry in self._others), self.sources, self.blocks)
        return learned(tuple(np.concatenate(groups) for groups in zip(subsets, recipes, strict=True)), scores)

    def _points(self, weights: Array) -> Points:
        """Features of equal merges, whose blocks have the same weights and scales of 1."""
        rows = np.repeat(weights[:, None, :], len(self.blocks), axis=1)
        return features(rows, np.ones((len(weights), len(self.blocks))))

    @property
    def _left(self) -> int:
        """Subsets nobody has scored."""
        met = {c.subset for c in self._state.candidates if len(c.subset) >= SMALLEST}
        return self.space.subsets - len(met)

    def _unmet(self, met: Collection[Chromosome], rng: np.random.Generator) -> Chromosome:
        """A random subset nobody has scored; there is one."""
        # Drawing is quick while much is left; near the end few draws are new, and the rest is read instead.
        for _ in range(_TRIES):
            drawn = tuple(sorted(random_chromosome(self.space, rng)))
            if drawn not in met:
                return drawn
        return next(unmet(self.space, met))

    def _genes(self, candidate: SubsetCandidate) -> Chromosome:
        return tuple(sorted(self.sources.index(name) for name in candidate.chromosome))

    def _chromosome(self, recipe: Recipe) -> Chromosome | None:
        """The subset whose equal merge a recipe is, where this search may propose it."""
        genes = tuple(sorted(self.sources.index(name) for name in subset_of(recipe)))
        if not self.space.holds(genes):
            return None
        # By features, which know neither the order of sources nor those that weigh nothing.
        pair = recipe_features([self.recipe(genes), recipe], self.sources, self.blocks)
        return genes if all(np.array_equal(group[0], group[1]) for group in pair) else None

    def _description(self) -> dict[str, Any]:
        return {**super()._description(), "method": "bayesian", "known": known_records(self.known)}
