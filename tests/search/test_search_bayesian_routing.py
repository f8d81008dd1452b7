"""Stage 2 by a model, on landscapes whose optimum is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from search_landscapes import BLOCKS, Scorer, names

from sfkit.errors import InputError
from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe, routed
from sfkit.search import Constraints, RoutingSearch, RoutingSettings
from sfkit.search.bayesian_routing import BayesianRoutingSearch, BayesianRoutingSettings
from sfkit.search.surrogate import recipe_features

SOURCES = names(3)
WEIGHTS, SCALES = (0.6, 0.3, 0.1), (1.2, 0.8, 1.0)
QUICK = BayesianRoutingSettings(evaluations=30)


def bowl(recipe: Recipe) -> float:
    """Distance of weights and scales to a point inside, rounded off at the bottom: 0 there."""
    apart = 0.0
    for block, scale in zip(recipe.blocks, SCALES, strict=True):
        weights, own = recipe.of(block)
        apart += sum((weights.get(s, 0.0) - w) ** 2 for s, w in zip(SOURCES, WEIGHTS, strict=True))
        apart += (own - scale) ** 2
    return math.sqrt(apart + 1e-4)


def search(
    settings: BayesianRoutingSettings = QUICK, scorer: Scorer | None = None, **more: object
) -> BayesianRoutingSearch:
    return BayesianRoutingSearch(SOURCES, BLOCKS, scorer or Scorer(bowl), settings, **more)  # type: ignore[arg-type]


def two_valleys(recipe: Recipe) -> float:
    """A shallow valley at equal weights, and a deeper one where the first source is nearly alone."""
    weight = recipe.of(BLOCKS[0])[0][SOURCES[0]]
    return 2.0 - math.exp(-(((weight - 1 / 3) / 0.1) ** 2)) - 1.5 * math.exp(-(((weight - 0.95) / 0.2) ** 2))


def test_what_lies_far_from_x_0_is_found() -> None:
    far, near = [], []
    for seed in range(3):
        settings = replace(QUICK, scaled=False, seed=seed)
        far.append(search(settings, scorer=Scorer(two_valleys)).run().score)
        near.append(search(replace(settings, far=0.0), scorer=Scorer(two_valleys)).run().score)
    assert max(far) < 0.7
    assert np.median(near) > 0.9


def test_x_0_is_first_and_the_result_is_never_worse() -> None:
    found = search()
    found.run()
    first = found.candidates[0]
    assert first.recipe == Recipe.equal(SOURCES, BLOCKS)
    assert found.best is not None
    assert found.best.score <= first.score
    assert len(found.candidates) == 30


@pytest.mark.parametrize("tied", [True, False])
def test_it_comes_nearer_than_cma_es_with_as_many_evaluations(tied: bool) -> None:
    ours, theirs = [], []
    for seed in range(3):
        mine = search(BayesianRoutingSettings(evaluations=50, tied=tied, seed=seed))
        cma = RoutingSettings(evaluations=50, tied=tied, converge=False, seed=seed)
        ours.append(mine.run().score)
        theirs.append(RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), cma).run().score)
    assert np.median(ours) < np.median(theirs)


def test_vectors_have_the_features_of_the_recipes_they_stand_for() -> None:
    limits = Constraints(frozen_blocks=(BLOCKS[1],))
    for tied in (True, False):
        one = search(BayesianRoutingSettings(tied=tied), constraints=limits)
        draws = np.random.default_rng(0).standard_normal((5, one.encoding.dimension))
        recipes = [one.encoding.decode(x) for x in draws]
        for mine, theirs in zip(one._points(draws), recipe_features(recipes, SOURCES, BLOCKS), strict=True):
            assert mine == pytest.approx(theirs, abs=1e-12)


def test_what_stage_1_scored_teaches_and_is_not_asked_again() -> None:
    known = [Known(Recipe.equal(subset, BLOCKS), 5.0) for subset in (SOURCES[:2], (*SOURCES, "other"))]
    scorer = Scorer(bowl)
    found = BayesianRoutingSearch(SOURCES, BLOCKS, scorer, QUICK, known=known)
    found.step()
    found.step()
    assert found.candidates[1].prediction is not None
    assert not set(scorer.asked) & {entry.recipe for entry in known}


def test_a_start_is_scored_second_and_frozen_blocks_stay() -> None:
    start = routed(SOURCES, BLOCKS, [(0.5, 0.25, 0.25)] * 3, (1.0, 1.0, 1.1))
    found = search(QUICK, start=start, constraints=Constraints(frozen_blocks=(BLOCKS[1],)))
    found.run()
    assert found.candidates[1].recipe == start
    assert all(candidate.recipe.of(BLOCKS[1])[1] == 1.0 for candidate in found.candidates)


@pytest.mark.parametrize("batch", [1, 4])
def test_an_interrupted_step_proposes_the_same_again(batch: int) -> None:
    settings = BayesianRoutingSettings(evaluations=18, batch=batch)
    whole, other = search(settings), search(settings)
    whole.run()
    failing = True

    def broken(recipes: Sequence[Recipe]) -> list[Outcome]:
        nonlocal failing
        failing = not failing
        if failing:
            raise KeyboardInterrupt
        return Scorer(bowl)(recipes)

    with other.scored_by(broken):
        while not other.done:
            try:
                other.step()
            except KeyboardInterrupt:
                continue
    assert other.state == whole.state


def test_entropy_is_part_of_what_is_minimised() -> None:
    found = search(BayesianRoutingSettings(evaluations=12, entropy=0.5))
    best = found.run()
    assert best.fitness == min(candidate.fitness for candidate in found.candidates)
    assert best.penalty > 0.0


def test_failures_lose_and_end_nothing() -> None:
    def score(recipe: Recipe) -> float:
        return bowl(recipe) if recipe.scales[0] <= 1.0 else math.inf

    found = BayesianRoutingSearch(SOURCES, BLOCKS, Scorer(score), QUICK)
    assert found.run().score <= bowl(Recipe.equal(SOURCES, BLOCKS))
    hopeless = BayesianRoutingSearch(SOURCES, BLOCKS, Scorer(lambda _: math.inf), QUICK)
    for _ in hopeless:
        pass
    assert len(hopeless.candidates) == 30


def test_the_history_tells_what_was_foretold() -> None:
    found = search()
    found.run()
    table = found.history
    assert table["predicted_mean"].isna().sum() == 2  # x = 0, and a draw before two scores are known
    told = table.dropna(subset=["predicted_mean"])
    assert ((told["score"] - told["predicted_mean"]).abs() <= 4.0 * told["predicted_sd"] + 0.05).mean() > 0.8


def test_a_hold_out_is_refused() -> None:
    with pytest.raises(InputError, match="holdout"):
        BayesianRoutingSettings(holdout=0.5)


def test_the_region_shrinks_where_nothing_better_is_found() -> None:
    flat = search(replace(QUICK, patience=8), scorer=Scorer(lambda _: 1.0))
    flat.run()
    first = QUICK.sigma
    assert [c.sigma for c in flat.candidates][:9] == [first] * 9
    assert flat.candidates[9].sigma == first / 2.0
    assert flat.candidates[17].sigma == first / 4.0
