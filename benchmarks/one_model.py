"""One model over subsets, weights and scales together, without stages.

It begins as Stage 1 does: every source alone, all together, and random subsets. What is proposed next is the
smallest bound among all equal merges nobody has scored, and draws in a trust region around the best recipe so
far, over the sources that it uses. The region grows and shrinks as that of ``BayesianRoutingSearch``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from stage2_worlds import SearchWorld

from sfkit.merging.recipe import Recipe
from sfkit.search import BayesianRoutingSettings
from sfkit.search.acquisition import equal_weights, listed
from sfkit.search.encoding import Encoding
from sfkit.search.gaussian_process import Array, Points
from sfkit.search.operators import SubsetSpace, random_chromosome
from sfkit.search.surrogate import Surrogate, features, learned, recipe_features

FIRST, DRAWN, ROUNDS, BETA = 8, 256, 3, 2.0
REGION = BayesianRoutingSettings()


def one_model(world: SearchWorld, evaluations: int = 160) -> Iterator[float]:
    """Scores of its evaluations; a source alone costs one and wins nothing."""
    pool, names, blocks = world.pool, world.pool.names, world.pool.blocks
    rng = np.random.default_rng([world.seed, 4])
    space = SubsetSpace.free(len(names))
    subsets = [tuple(range(len(names)))]
    while len(subsets) < min(FIRST, space.subsets):
        drawn = tuple(sorted(random_chromosome(space, rng)))
        subsets += [drawn] if drawn not in subsets else []
    scores: dict[Recipe, float] = {}

    def scored(recipe: Recipe, *, wins: bool = True) -> float:
        scores[recipe] = world.scorer([recipe])[0].score
        return scores[recipe] if wins else math.inf

    for genes in ((gene,) for gene in range(len(names))):
        yield scored(pool.equal(names[genes[0]]), wins=False)
    for subset in subsets:
        yield scored(pool.equal(*(names[gene] for gene in subset)))
    met, radius, good, bad = set(subsets), float(REGION.sigma), 0, 0
    while len(scores) < evaluations:
        several = {recipe: score for recipe, score in scores.items() if len(recipe.sources) > 1}
        best = min(several, key=lambda recipe: several[recipe])
        surrogate = learned(recipe_features(scores, names, blocks), np.array(list(scores.values())))
        x, encoding, bound = near(surrogate, best, names, radius, rng)
        fresh = [genes for genes in listed(space) if genes not in met]
        rows = np.repeat(equal_weights(fresh, len(names))[:, None, :], len(blocks), axis=1)
        bounds = (
            surrogate.bounds(features(rows, np.ones(rows.shape[:2])), BETA)[2]
            if fresh
            else np.array([math.inf])
        )
        if bounds.min() <= bound:
            subset = fresh[int(np.argmin(bounds))]
            met.add(subset)
            yield scored(pool.equal(*(names[gene] for gene in subset)))
            continue
        recipe = encoding.decode(x)
        better = scored(recipe) < several[best]
        good, bad = (good + 1, 0) if better else (0, bad + 1)
        if 2 * good >= REGION.patience:
            radius, good = min(2.0 * radius, 4.0 * float(REGION.sigma)), 0
        elif bad >= REGION.patience:
            radius, bad = radius / 2.0, 0
        radius = float(REGION.sigma) if radius < REGION.smallest else radius
        yield scores[recipe]


def near(
    surrogate: Surrogate, best: Recipe, names: tuple[str, ...], radius: float, rng: np.random.Generator
) -> tuple[Array, Encoding, float]:
    """The vector of the smallest bound among draws around a recipe, its encoding, and that bound."""
    encoding = Encoding(best.sources, best.blocks)
    centre, lowest = encoding.encode(best), math.inf
    around, reach, chosen = centre, radius, centre
    for turn in range(ROUNDS):
        draws = around + reach * rng.standard_normal((DRAWN, centre.size))
        if turn == 0:
            draws = np.where(rng.random(draws.shape) < rng.random((DRAWN, 1)), draws, around)
        bounds = surrogate.bounds(points(encoding, draws, names), BETA)[2]
        first = int(np.argmin(bounds))
        if bounds[first] < lowest:
            chosen, lowest = draws[first], float(bounds[first])
        around, reach = chosen, reach / 3.0
    return chosen, encoding, lowest


def points(encoding: Encoding, draws: Array, names: tuple[str, ...]) -> Points:
    """Features of the recipes that rows of ``draws`` stand for, with tied weights."""
    count, blocks = len(encoding.sources), len(encoding.blocks)
    powers = np.exp(draws[:, :count] - draws[:, :count].max(axis=1, keepdims=True))
    rows = np.zeros((len(draws), blocks, len(names)))
    where = [names.index(source) for source in encoding.sources]
    rows[:, :, where] = (powers / powers.sum(axis=1, keepdims=True))[:, None, :]
    half = (encoding.gamma[1] - encoding.gamma[0]) / 2.0
    return features(rows, 1.0 + half * np.tanh(draws[:, count:] / 2.0))
