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
from sfkit.search.bayesian_routing import BayesianRoutingSearch
from sfkit.search.bayesian_settings import BayesianRoutingSettings
from sfkit.search.surrogate import routing_features

SOURCES = names(3)
WEIGHTS, SCALES = (0.6, 0.3, 0.1), (1.2, 0.8, 1.0)
QUICK = BayesianRoutingSettings(evaluations=24)


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


def test_x_0_is_first_and_the_result_is_never_worse() -> None:
    found = search()
    found.run()
    first = found.candidates[0]
    assert first.recipe == Recipe.equal(SOURCES, BLOCKS)
    assert found.best is not None
    assert found.best.score <= first.score
    assert len(found.candidates) == QUICK.evaluations


@pytest.mark.parametrize("tied", [True, False])
def test_it_comes_nearer_than_cma_es_with_as_many_evaluations(tied: bool) -> None:
    ours, theirs = [], []
    for seed in range(3):
        mine = search(BayesianRoutingSettings(evaluations=40, tied=tied, seed=seed))
        cma = RoutingSettings(evaluations=40, tied=tied, converge=False, seed=seed)
        ours.append(mine.run().score)
        theirs.append(RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), cma).run().score)
    assert np.median(ours) < np.median(theirs)


def test_vectors_have_the_features_of_the_recipes_they_stand_for() -> None:
    limits = Constraints(frozen_blocks=(BLOCKS[1],))
    for tied in (True, False):
        one = search(BayesianRoutingSettings(tied=tied), constraints=limits)
        draws = np.random.default_rng(0).standard_normal((5, one.encoding.dimension))
        recipes = [one.encoding.decode(x) for x in draws]
        seen = routing_features(recipes, SOURCES, BLOCKS, tied=tied)
        for mine, theirs in zip(one._points(draws), seen, strict=True):
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
    found = search(BayesianRoutingSettings(evaluations=7, entropy=0.5))
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
    assert len(hopeless.candidates) == QUICK.evaluations


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


@pytest.mark.parametrize("batch", [1, 4])
def test_every_second_proposal_is_bold(batch: int) -> None:
    found = search(replace(QUICK, evaluations=14, batch=batch))
    found.run()
    knee, met = found.candidates[0].score, set()
    for candidate in found.candidates:
        told = candidate.prediction
        if told is not None and told.mean < knee:  # above it the bound is of bent scores
            bold = candidate.number % 2 == 1
            assert (told.mean - told.acquisition) / told.sd == pytest.approx(2.0 if bold else 1.0, abs=1e-3)
            met.add(bold)
    assert met == {False, True}


def test_without_far_draws_none_is_bold() -> None:
    found = search(replace(QUICK, evaluations=10, far=0.0))
    found.run()
    knee = found.candidates[0].score
    told = [c.prediction for c in found.candidates if c.prediction is not None and c.prediction.mean < knee]
    assert [(one.mean - one.acquisition) / one.sd for one in told] == pytest.approx(
        [1.0] * len(told), abs=1e-3
    )
    assert told


def test_the_region_shrinks_where_nothing_better_is_found() -> None:
    flat = search(replace(QUICK, patience=4), scorer=Scorer(lambda _: 1.0))
    flat.run()
    first = QUICK.sigma
    # 2, 4, 6 and 8 are of the region; odd ones are bold, and do not count.
    assert [c.sigma for c in flat.candidates][:9] == [first] * 9
    assert flat.candidates[9].sigma == first / 2.0
    near = search(replace(QUICK, patience=4, far=0.0, sigma=0.2), scorer=Scorer(lambda _: 1.0))
    near.run()
    assert [c.sigma for c in near.candidates][4:6] == [0.2, 0.1]
    # Its draws follow: without a bold one none is far from x = 0.
    found = search(replace(QUICK, far=0.0, sigma=0.03, evaluations=3))
    found.run()
    assert 0.0 < max(abs(number) for c in found.candidates for number in c.x) < 0.3


def test_a_search_that_was_begun_again_fits_as_one_that_was_not() -> None:
    whole = search(replace(QUICK, evaluations=12))
    whole.run()
    again = search(replace(QUICK, evaluations=12))
    while not again.done:
        again._fitted = None  # as after a start from what is written
        again.step()
    assert again.state == whole.state
