"""Model-based Stage 1 on the table of all subsets: alone, in batches, and in a pool that has grown.

An evaluation is a look into the table, and a source scored alone costs, and wins nothing. As many workers as
a batch has are simulated by ``scale.simulate``: evaluations of one length but for a spread of 5 %, and a
batch begins when the one before has ended. ``optimum.py`` runs all of it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from landscapes import Landscape
from scale import simulate
from scipy.special import ndtr

from sfkit.evaluation.known import Known
from sfkit.search import BayesianSubsetSearch, BayesianSubsetSettings, SubsetSearch, SubsetSettings
from sfkit.search.acquisition import equal_weights, listed, smallest_bound
from sfkit.search.base import Search
from sfkit.search.breeding import Draft
from sfkit.search.gaussian_process import Array, GaussianProcess, Points, distances, matern
from sfkit.search.operators import Chromosome
from sfkit.search.records import SubsetCandidate
from sfkit.search.surrogate import Prediction, Surrogate

MOST = 160
"""Evaluations that are proposed by the model, at least."""
BLOCK = ("all",)
GROWN = (
    "model, nothing known",
    "model, knows the evaluations before",
    "paper's, nothing known",
    "paper's, with the store",
    "paper's, with the store, started from the best before",
)
"""Ways to search a pool that has gained a source."""


class ThompsonSubsetSearch(BayesianSubsetSearch):
    """The same search, but for what chooses a batch: each proposal is the best of one draw of the posterior.

    Thompson sampling (Thompson 1933; in batches Kandasamy et al. 2018): the draws are joint ones, at all
    subsets that may be proposed, so that a batch spreads as far as the model is unsure. Of draws that agree
    the later one takes its next best. For spaces that can be listed.
    """

    def _proposed(self, rng: np.random.Generator) -> tuple[list[Draft], list[Prediction | None]]:
        model = self._model()
        assert model is not None, "every subset of a table has a score"
        met = {self._genes(candidate) for candidate in self._state.candidates}
        fresh = [chromosome for chromosome in listed(self.space) if chromosome not in met]
        points = self._points(equal_weights(fresh, len(self.sources)))
        count = min(self.settings.batch, len(fresh))
        draws = drawn(model.process, tuple(points[group] for group in model.groups), count, rng)
        chosen: list[int] = []
        for values in draws:
            values[chosen] = np.inf
            chosen.append(int(np.argmin(values)))
        return [Draft(fresh[n], (), ("model",)) for n in chosen], [None] * count


def drawn(process: GaussianProcess, points: Points, count: int, rng: np.random.Generator) -> Array:
    """Joint draws of the noiseless value at m points, (count, m) (Rasmussen and Williams, eq. 2.24)."""
    across = matern(distances(points, process.points), process.lengths)
    explained = across @ process.inverse.T
    left = matern(distances(points, points), process.lengths) - explained @ explained.T
    # Points near those it learned from leave next to no variance, and rounding less than none.
    factor = np.linalg.cholesky(left + 1e-6 * np.eye(len(left)))
    noise = rng.standard_normal((count, len(left)))
    mean = process.mean + across @ process.weights
    return np.asarray(mean + np.sqrt(process.variance) * noise @ factor.T)


class ExpectedImprovementSubsetSearch(BayesianSubsetSearch):
    """The same search, but for what is proposed: the largest expected improvement, not the smallest bound.

    Over the best score so far of a subset of two sources or more (EGO, Jones et al. 1998); ``acquisition`` of
    a prediction is the improvement, below 0.
    """

    def _acquired(
        self, model: Surrogate, met: set[Chromosome], rng: np.random.Generator
    ) -> tuple[Chromosome, Prediction]:
        assert self.best is not None, "every subset of a table has a score"
        lowest = self.best.score

        def least(weights: Array) -> Array:
            return -improvement(lowest, *model.predict(self._points(weights)))

        best = [self._genes(self._state.candidates[number]) for number in self._state.populations[-1]]
        chromosome = smallest_bound(least, self.space, len(self.sources), met, best, rng)
        weights = equal_weights([chromosome], len(self.sources))
        mean, sd = (float(value[0]) for value in model.predict(self._points(weights)))
        return chromosome, Prediction(mean, sd, float(least(weights)[0]))


def improvement(lowest: float, mean: Array, sd: Array) -> Array:
    """Expected gain on the lowest score of a normal variable (Jones et al. 1998, eq. 15)."""
    z = (lowest - mean) / sd
    return np.asarray((lowest - mean) * ndtr(z) + sd * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi))


CHOOSERS = {"kriging believer": BayesianSubsetSearch, "Thompson": ThompsonSubsetSearch}
"""What chooses the proposals of a batch; the first is the library's."""


def search_of(
    land: Landscape, seed: int, batch: int = 1, chooser: type[BayesianSubsetSearch] = BayesianSubsetSearch
) -> BayesianSubsetSearch:
    """The search itself on the table of scores, ready for its first step."""
    settings = BayesianSubsetSettings(generations=-(-MOST // batch), batch=batch, seed=seed)
    return chooser(land.names, BLOCK, land.scored, settings)


def run(land: Landscape, seed: int, chooser: type[BayesianSubsetSearch] = BayesianSubsetSearch) -> list[int]:
    """The masks it evaluates one at a time, in order, up to the optimum."""
    search = search_of(land, seed, chooser=chooser)
    for _ in search:
        if any(optimal(land, candidate) for candidate in search.candidates):
            break
    return [land.mask(c.subset) for c in search.candidates]


def optimal(land: Landscape, candidate: SubsetCandidate) -> bool:
    """Whether it is the best subset of two sources or more."""
    return len(candidate.subset) >= 2 and candidate.score == land.best


def in_batches(
    land: Landscape,
    batch: int,
    seeds: Sequence[int],
    chooser: type[BayesianSubsetSearch] = BayesianSubsetSearch,
) -> pd.DataFrame:
    """A row a seed: what ``batch`` workers need until the optimum.

    ``needed`` evaluations (infinite where it was not found), ``rounds`` at whose end workers wait for one
    another, ``wall`` time in evaluations, ``busy`` share of the workers' time, CPU ``seconds`` of the model
    an evaluation.
    """
    rows = []
    for seed in seeds:
        search, sizes, began = search_of(land, seed, batch, chooser), [], time.process_time()
        hits: list[int] = []
        for generation in search:
            sizes.append(len(generation.candidates))
            hits = [c.number + 1 for c in generation.candidates if optimal(land, c)]
            if hits:
                break
        seconds = (time.process_time() - began) / len(search.candidates)
        wall, busy = simulate(sizes, 1.0, batch)
        needed, rounds = (hits[0], len(sizes)) if hits else (np.inf, np.inf)
        rows.append((seed, needed, rounds, wall if hits else np.inf, busy / (wall * batch), seconds))
    return pd.DataFrame(rows, columns=["seed", "needed", "rounds", "wall", "busy", "seconds"])


def newcomers(land: Landscape) -> tuple[str, ...]:
    """The sources of the best subset."""
    best = next(mask for mask, score in land.scores.items() if score == land.best and mask.bit_count() >= 2)
    return tuple(name for n, name in enumerate(land.names) if best >> n & 1)


def grown(land: Landscape, newcomer: str, seed: int) -> Iterator[tuple[str, float]]:
    """The pool without a source is searched to the end, then the whole pool, in each of the ways ``GROWN``.

    Yields:
        Way, and new evaluations until the best subset, infinite where it was not found. What the same method
        evaluated before costs nothing, where it is known.
    """
    scorer, few = land.scored, tuple(name for name in land.names if name != newcomer)
    model, paper = BayesianSubsetSettings(seed=seed), SubsetSettings(seed=seed)
    before = BayesianSubsetSearch(few, BLOCK, scorer, model)
    before.run()
    known = tuple(Known(c.recipe, c.score) for c in before.candidates if not c.repeated)
    known_to_paper = SubsetSearch(few, BLOCK, scorer, paper)
    start = known_to_paper.run().subset
    fresh = SubsetSearch(land.names, BLOCK, scorer, paper)
    ways: tuple[tuple[Search[SubsetCandidate], Sequence[SubsetCandidate]], ...] = (
        (BayesianSubsetSearch(land.names, BLOCK, scorer, model), ()),
        (BayesianSubsetSearch(land.names, BLOCK, scorer, model, known=known), before.candidates),
        (fresh, ()),
        (fresh, known_to_paper.candidates),
        (SubsetSearch(land.names, BLOCK, scorer, paper, start=[start]), known_to_paper.candidates),
    )
    for way, (search, stored) in zip(GROWN, ways, strict=True):
        yield way, new_evaluations(land, search, stored)


def new_evaluations(
    land: Landscape, search: Search[SubsetCandidate], before: Sequence[SubsetCandidate]
) -> float:
    """Evaluations not stored before, until the best subset."""
    while not search.done and not any(optimal(land, candidate) for candidate in search.candidates):
        search.step()
    stored, seen = {c.recipe for c in before}, set()
    for candidate in search.candidates:
        if candidate.recipe not in stored:
            seen.add(candidate.recipe)
        if optimal(land, candidate):
            return len(seen)
    return np.inf
