"""One model over subsets, weights and scales together, without stages.

It begins as Stage 1 does: every source alone, all together, and random subsets. Then it is
``BayesianRoutingSearch`` over the sources of the best recipe so far: its views of features by evidence, its
bent scores, its region, its bold proposals and draws. What differs is that the model learns from merges of
all sources, knows no x = 0 but bends above the best equal merge so far, and that every proposal may as well
be an equal merge nobody has scored, where its bound is smaller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from stage2_worlds import SearchWorld

from sfkit.evaluation.outcome import Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search import BayesianRoutingSearch, BayesianRoutingSettings
from sfkit.search.acquisition import equal_weights, listed
from sfkit.search.encoding import Vector
from sfkit.search.gaussian_process import Array, Points
from sfkit.search.operators import SubsetSpace, random_chromosome
from sfkit.search.routing_records import Distribution
from sfkit.search.surrogate import Surrogate, learned, routing_features, routing_points, routing_views

FIRST, REFIT = 8, 3
SETTINGS = BayesianRoutingSettings()


class Around(BayesianRoutingSearch):
    """Proposals of Stage 2 around a recipe, seen among all sources of a pool; it scores nothing itself."""

    def __init__(self, recipe: Recipe, names: Sequence[str], scorer: Scorer) -> None:
        super().__init__(recipe.sources, recipe.blocks, scorer, SETTINGS)
        self.centre = self.encoding.encode(recipe)
        self._width, self._columns = len(names), [names.index(source) for source in recipe.sources]

    def proposed(
        self, model: Surrogate, radius: float, rng: np.random.Generator, *, bold: bool
    ) -> tuple[Vector, float]:
        """A vector, and its bound."""
        spread = (radius,) * self.encoding.dimension
        region = Distribution(tuple(float(m) for m in self.centre), radius, spread)
        x, told = self._acquired(model, region, rng, bold=bold)
        return x, told.acquisition

    def _points(self, draws: Array) -> Points:
        rows, scales = self._rows_and_scales(draws)
        among = np.zeros((*rows.shape[:2], self._width))
        among[:, :, self._columns] = rows
        return routing_points(among, scales, tied=True)


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

    def scored(recipe: Recipe) -> float:
        scores[recipe] = world.scorer([recipe])[0].score
        return scores[recipe]

    for name in names:
        scored(pool.equal(name))
        yield math.inf
    for subset in subsets:
        yield scored(pool.equal(*(names[gene] for gene in subset)))
    knee = min(score for recipe, score in scores.items() if len(recipe.sources) > 1)
    met, radius, good, bad = set(subsets), SETTINGS.sigma, 0, 0
    fitted: Surrogate | None = None
    while len(scores) < evaluations:
        several = {recipe: score for recipe, score in scores.items() if len(recipe.sources) > 1}
        best = min(several, key=lambda recipe: several[recipe])
        points = routing_features(scores, names, blocks, tied=True)
        views = routing_views(len(blocks), tied=True)
        like = None if len(scores) % REFIT == 0 else fitted
        surrogate = learned(points, np.array([*scores.values()]), knee=knee, like=like, views=views)
        fitted = like or surrogate
        around = Around(best, names, world.scorer)
        bold = around._bold(len(scores))
        x, lowest = around.proposed(surrogate, radius, rng, bold=bold)
        fresh = [genes for genes in listed(space) if genes not in met]
        bounds = equal_bounds(surrogate, fresh, names, blocks, SETTINGS.beta / (1.0 if bold else 2.0))
        if fresh and bounds.min() <= lowest:
            subset = fresh[int(np.argmin(bounds))]
            met.add(subset)
            score = scored(pool.equal(*(names[gene] for gene in subset)))
            knee = min(knee, score)
            yield score
            continue
        recipe = around.encoding.decode(x)
        better = scored(recipe) < several[best]
        # A bold one was not drawn in the region, and says nothing of how wide it should be.
        if not bold:
            good, bad = (good + 1, 0) if better else (0, bad + 1)
            if 2 * good >= SETTINGS.patience:
                radius, good = min(2.0 * radius, 4.0 * SETTINGS.sigma), 0
            elif bad >= SETTINGS.patience:
                radius, bad = radius / 2.0, 0
            radius = SETTINGS.sigma if radius < SETTINGS.smallest else radius
        yield scores[recipe]


def equal_bounds(
    surrogate: Surrogate,
    fresh: Sequence[tuple[int, ...]],
    names: Sequence[str],
    blocks: Sequence[str],
    beta: float,
) -> Array:
    """The bound of each subset's equal merge, (m,)."""
    rows = np.repeat(equal_weights(fresh, len(names))[:, None, :], len(blocks), axis=1)
    return surrogate.bounds(routing_points(rows, np.ones(rows.shape[:2]), tied=True), beta)[2]
