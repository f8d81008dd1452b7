"""Stage 2 against a known optimum, and what makes it reproducible."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_landscapes import BLOCKS, Killed, Scorer, ShufflingScorer, StoredScorer, names

from sfkit.errors import InputError, SfkitError
from sfkit.merging.recipe import Recipe, routed
from sfkit.search import Constraints, RoutingSearch, RoutingSettings, mean_entropy
from sfkit.search.cma_es import CmaEs, default_population, finite_fitness

SOURCES = names(4)
WEIGHTS = (0.5, 0.3, 0.15, 0.05)
SCALES = (0.6, 1.0, 1.4)
SMALL = RoutingSettings(evaluations=60, seed=2)


def bowl(recipe: Recipe) -> float:
    """Squared distance to WEIGHTS and SCALES over all blocks: 0 at the known optimum."""
    weights = sum((w - t) ** 2 for row in recipe.weights for w, t in zip(row, WEIGHTS, strict=True))
    return weights + sum((g - t) ** 2 for g, t in zip(recipe.scales, SCALES, strict=True))


def logit_bowl(recipe: Recipe) -> float:
    """A quadratic in the space CMA-ES moves in: logits up to a constant, and the inverse of eq. 11."""
    logits = np.log(recipe.weights[0]) - np.log(WEIGHTS)
    scales = np.array([math.log((g - 0.25) / (1.75 - g)) for g in recipe.scales])
    wanted = np.array([math.log((g - 0.25) / (1.75 - g)) for g in SCALES])
    return float(((logits - logits.mean()) ** 2).sum() + ((scales - wanted) ** 2).sum())


def trace(search: RoutingSearch) -> list[tuple]:
    return [(c.x, c.recipe, c.score, c.penalty, c.sigma, c.axes, c.origin) for c in search.candidates]


@pytest.mark.parametrize("landscape", [bowl, logit_bowl])
def test_finds_the_known_optimum(landscape) -> None:
    search = RoutingSearch(SOURCES, BLOCKS, Scorer(landscape), RoutingSettings(evaluations=1500))
    best = search.run()
    assert best.score < 1e-8
    assert best.recipe.weights[0] == pytest.approx(WEIGHTS, abs=1e-3)
    assert best.recipe.scales == pytest.approx(SCALES, abs=1e-3)


def test_finds_block_specific_weights_that_tied_routing_cannot() -> None:
    wanted = {"backbone": (0.8, 0.2), "volume": (0.5, 0.5), "head": (0.1, 0.9)}

    def landscape(recipe: Recipe) -> float:
        return sum(abs(recipe.of(block)[0]["source0"] - wanted[block][0]) for block in BLOCKS)

    options = {"evaluations": 800, "scaled": False}
    tied, free = (
        RoutingSearch(names(2), BLOCKS, Scorer(landscape), RoutingSettings(tied=tied, **options)).run()
        for tied in (True, False)
    )
    assert free.score < 1e-3
    assert tied.score == pytest.approx(0.7, abs=1e-3)
    for block, row in zip(BLOCKS, free.recipe.weights, strict=True):
        assert row == pytest.approx(wanted[block], abs=1e-3)


def test_the_first_candidate_is_exactly_the_equal_weight_merge() -> None:
    scorer = Scorer(bowl)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, SMALL)
    generation = search.step()
    assert scorer.calls == [(Recipe.equal(SOURCES, BLOCKS),)]
    assert (generation.number, generation.candidates[0].origin) == (0, "equal")
    assert set(generation.candidates[0].x) == {0.0}


@given(st.integers(0, 2**31), st.floats(0, 2))
@settings(max_examples=15, deadline=None)
def test_never_returns_worse_than_it_got(seed: int, entropy: float) -> None:
    rng = np.random.default_rng(seed)
    scores: dict[Recipe, float] = {}

    def landscape(recipe: Recipe) -> float:
        return scores.setdefault(recipe, float(rng.random()))

    options = RoutingSettings(evaluations=30, seed=seed, entropy=entropy)
    search = RoutingSearch(SOURCES, BLOCKS, Scorer(landscape), options)
    best = search.run()
    assert best.fitness <= search.candidates[0].fitness
    assert best.fitness == min(scores[c.recipe] + entropy * mean_entropy(c.recipe) for c in search.candidates)


@pytest.mark.parametrize(("budget", "last"), [(1, 1), (5, 4), (11, 10), (12, 1), (31, 10), (36, 5)])
def test_the_budget_counts_everything_and_cuts_the_last_population(budget: int, last: int) -> None:
    options = RoutingSettings(evaluations=budget, population=10)
    scorer = Scorer(bowl)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, options)
    sizes = [len(generation.candidates) for generation in search]
    assert sum(sizes) == len(scorer.asked) == budget
    assert sizes[-1] == last
    assert set(sizes[1:-1]) <= {10}
    assert search.reason == f"the budget of {budget} evaluations is used up"


def test_a_cut_population_begins_like_a_whole_one() -> None:
    cut, whole = (
        RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), RoutingSettings(evaluations=n, population=10))
        for n in (36, 41)
    )
    cut.run()
    whole.run()
    assert trace(whole)[:36] == trace(cut)


def test_the_default_population_is_pycmas() -> None:
    search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl))
    assert search.encoding.dimension == 7
    assert search.population == 4 + math.floor(3 * math.log(7)) == 9
    assert [default_population(n) for n in (2, 9, 44)] == [6, 10, 15]


def test_a_generation_is_one_call_and_nothing_is_scored_twice() -> None:
    scorer = Scorer(bowl)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, SMALL)
    search.run()
    assert len(scorer.calls) == search.generation + 1
    assert len(set(scorer.asked)) == len(scorer.asked)


def test_recipes_that_coincide_are_scored_once() -> None:
    scorer = Scorer(bowl)
    start = Recipe.equal(SOURCES, BLOCKS)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, SMALL, start=start)
    search.step()
    assert [c.repeated for c in search.candidates] == [False, True]
    assert scorer.asked == [start]


def test_the_same_seed_gives_the_same_search_and_another_another() -> None:
    runs = [
        RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), RoutingSettings(evaluations=60, seed=s))
        for s in (4, 4, 5)
    ]
    for search in runs:
        search.run()
    assert trace(runs[0]) == trace(runs[1])
    assert trace(runs[0]) != trace(runs[2])


def test_the_order_of_an_engines_work_changes_nothing() -> None:
    searches = [RoutingSearch(SOURCES, BLOCKS, kind(bowl), SMALL) for kind in (Scorer, ShufflingScorer)]
    for search in searches:
        search.run()
    assert trace(searches[0]) == trace(searches[1])


def test_numpys_global_state_is_neither_read_nor_written_and_no_file_appears(
    tmp_path, monkeypatch, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    results = []
    for seed in (0, 1):
        np.random.seed(seed)
        before = np.random.get_state()
        search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), SMALL)
        search.run()
        after = np.random.get_state()
        assert np.array_equal(before[1], after[1])
        assert before[2:] == after[2:]
        results.append(trace(search))
    assert results[0] == results[1]
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@given(st.integers(0, 60))
@settings(max_examples=12, deadline=None)
def test_killed_anywhere_and_started_again_it_repeats_nothing(lives: int) -> None:
    whole = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), SMALL)
    whole.run()
    store: dict = {}
    first = StoredScorer(bowl, store, lives)
    try:
        RoutingSearch(SOURCES, BLOCKS, first, SMALL).run()
        assert lives >= 60
    except Killed:
        assert lives < 60
    second = StoredScorer(bowl, store)
    again = RoutingSearch(SOURCES, BLOCKS, second, SMALL)
    again.run()
    assert trace(again) == trace(whole)
    assert not set(first.computed) & set(second.computed)
    assert again.counts.cached == len(first.computed)


@given(st.integers(1, 59))
@settings(max_examples=12, deadline=None)
def test_a_step_that_was_interrupted_can_be_taken_again(lives: int) -> None:
    whole = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), SMALL)
    whole.run()
    scorer = StoredScorer(bowl, {}, lives)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, SMALL)
    with pytest.raises(Killed):
        search.run()
    scorer.lives = math.inf
    search.run()
    assert trace(search) == trace(whole)


def test_failed_candidates_lose_and_never_end_the_run() -> None:
    def landscape(recipe: Recipe) -> float:
        return math.inf if recipe.scales[0] > 1.05 else bowl(recipe)

    scorer = Scorer(landscape)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, RoutingSettings(evaluations=600))
    best = search.run()
    assert search.counts.failed > 5
    assert best.recipe.scales[0] <= 1.05
    assert best.score < 1e-4
    assert set(search.history.query("failed")["error"]) == {"out of memory"}
    late = search.candidates[-60:]
    assert sum(candidate.failed for candidate in late) < 10


def test_a_search_whose_every_sample_failed_returns_the_equal_merge() -> None:
    def landscape(recipe: Recipe) -> float:
        return 7.0 if recipe == Recipe.equal(SOURCES, BLOCKS) else math.inf

    search = RoutingSearch(SOURCES, BLOCKS, Scorer(landscape), RoutingSettings(evaluations=120))
    assert search.run().recipe == Recipe.equal(SOURCES, BLOCKS)
    assert search.counts.failed == 119
    nothing = RoutingSearch(SOURCES, BLOCKS, Scorer(lambda recipe: math.inf), SMALL)
    with pytest.raises(SfkitError, match="none of 60 candidates has a finite score"):
        nothing.run()


def test_failures_rank_behind_everything_in_their_order() -> None:
    assert finite_fitness([2.0, math.inf, 1.0, math.inf], worst=9.0) == [2.0, 11.0, 1.0, 13.0]
    assert finite_fitness([1.0, 2.0], worst=2.0) == [1.0, 2.0]


def test_a_flat_landscape_converges_unless_told_to_go_on() -> None:
    stopped = RoutingSearch(SOURCES, BLOCKS, Scorer(lambda recipe: 1.0), RoutingSettings(evaluations=400))
    assert stopped.run().number == 0
    assert stopped.counts.candidates < 400
    assert "CMA-ES has converged (tolfun" in stopped.reason
    options = RoutingSettings(evaluations=400, converge=False)
    forced = RoutingSearch(SOURCES, BLOCKS, Scorer(lambda recipe: 1.0), options)
    forced.run()
    assert forced.counts.candidates == 400


def test_a_wider_tolerance_stops_earlier() -> None:
    def run(tolfun: float) -> RoutingSearch:
        options = RoutingSettings(evaluations=3000, tolfun=tolfun)
        search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), options)
        search.run()
        return search

    loose, tight = run(1e-2), run(1e-11)
    assert "tolfun" in loose.reason
    assert loose.counts.candidates < tight.counts.candidates


def test_entropy_drives_towards_sparse_routing() -> None:
    def run(entropy: float):
        options = RoutingSettings(evaluations=500, entropy=entropy, scaled=False)
        return RoutingSearch(SOURCES, BLOCKS, Scorer(lambda recipe: 0.0), options).run()

    sparse = run(1.0)
    assert max(sparse.recipe.weights[0]) > 0.99
    assert sparse.penalty == pytest.approx(mean_entropy(sparse.recipe))
    assert run(0.0).recipe == Recipe.equal(SOURCES, BLOCKS)


def test_frozen_blocks_keep_scale_one_and_equal_weights() -> None:
    limits = Constraints(frozen_blocks=("volume",))
    for tied in (True, False):
        options = RoutingSettings(evaluations=40, tied=tied)
        search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), options, constraints=limits)
        search.run()
        for candidate in search.candidates:
            weights, scale = candidate.recipe.of("volume")
            assert scale == 1.0
            assert tied or set(weights.values()) == {0.25}
        assert len({candidate.recipe.scales[0] for candidate in search.candidates}) > 30


def test_a_start_is_scored_second_and_as_it_is_and_moves_the_mean() -> None:
    start = routed(SOURCES[:2], BLOCKS, [(0.9, 0.1)] * 3, (0.5, 1.0, 1.75))
    scorer = Scorer(bowl)
    options = RoutingSettings(evaluations=200, sigma=1e-3)
    search = RoutingSearch(SOURCES, BLOCKS, scorer, options, start=start)
    search.step()
    search.step()
    admitted = Recipe(SOURCES, BLOCKS, ((0.9, 0.1, 0.0, 0.0),) * 3, (0.5, 1.0, 1.75))
    assert scorer.asked[:2] == [Recipe.equal(SOURCES, BLOCKS), admitted]
    assert [c.origin for c in search.candidates[:3]] == ["equal", "start", "sample"]
    mean = np.mean([c.recipe.scales for c in search.candidates[2:]], axis=0)
    assert mean == pytest.approx((0.5, 1.0, 1.735), abs=2e-3)
    first = np.mean([c.recipe.weights[0] for c in search.candidates[2:]], axis=0)
    assert first == pytest.approx(np.array([0.9, 0.1, 0.01, 0.01]) / 1.02, abs=2e-3)


def test_a_start_is_never_lost() -> None:
    start = routed(SOURCES, BLOCKS, [WEIGHTS] * 3, SCALES)
    search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), SMALL, start=start)
    best = search.run()
    assert best.score == 0.0
    assert (best.origin, best.recipe) == ("start", start)


def test_populations_are_normal_draws_of_the_distribution_they_name() -> None:
    draws = 4000
    cma = CmaEs(np.array([1.0, -2.0, 0.5]), 0.7, draws, 11, tolfun=0.0, tolx=0.0)
    x = np.array(cma.ask())
    assert x.mean(axis=0) == pytest.approx([1.0, -2.0, 0.5], abs=5 * 0.7 / draws**0.5)
    assert np.cov(x.T) == pytest.approx(0.49 * np.eye(3), abs=0.06)
    assert cma.distribution.mean == (1.0, -2.0, 0.5)
    assert cma.distribution.sigma == 0.7
    assert cma.distribution.axes == pytest.approx((0.7,) * 3, rel=1e-3)


@pytest.mark.parametrize("size", [3, 4, 5, 9])
def test_every_vector_is_a_draw_of_its_own_generator(size: int) -> None:
    cma = CmaEs(np.zeros(4), 1.0, size, 6, tolfun=0.0, tolx=0.0)
    for iteration in range(1, 7):
        population = np.array(cma.ask())
        drawn = np.random.default_rng([6, 2, iteration]).standard_normal((size, 4))
        steps = population - np.array(cma.distribution.mean)
        # A vector's Mahalanobis length is that of the normal numbers it was made of; mirrors have another.
        lengths = [float(cma._es.mahalanobis_norm(step)) for step in steps]
        assert lengths == pytest.approx(np.linalg.norm(drawn, axis=1).tolist(), rel=1e-6)
        cma.tell([float(x @ x) for x in population])


def test_history_has_a_row_an_evaluation() -> None:
    search = RoutingSearch(SOURCES, BLOCKS, Scorer(bowl), RoutingSettings(evaluations=50, entropy=0.1))
    empty = search.history
    search.run()
    history = search.history
    assert list(history.columns) == list(empty.columns)
    assert history["candidate"].tolist() == list(range(50))
    assert (history["penalised"] == history["score"] + history["penalty"]).all()
    assert history["origin"].tolist() == ["equal"] + ["sample"] * 49
    for block in BLOCKS:
        rows = history[[f"weight:{block}:{source}" for source in SOURCES]]
        assert rows.sum(axis=1).tolist() == pytest.approx([1.0] * 50)
        assert history[f"scale:{block}"].between(0.25, 1.75).all()
    axes = history[[f"axis:{i}" for i in range(7)]].to_numpy()
    assert (np.diff(axes, axis=1) >= 0).all()
    assert history["penalised"].min() == search.best.fitness
    assert (history.groupby("generation")["sigma"].nunique() == 1).all()


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("evaluations", 0, "evaluations: found 0, expected a whole number of at least 1"),
        ("population", 2, "population: found 2, expected a whole number of at least 3"),
        ("sigma", 0.0, "sigma: found 0.0, expected a finite number above 0"),
        ("sigma", math.inf, "sigma: found inf"),
        ("gamma", (0.5, 2.0), r"gamma: found \[0.5, 2\]"),
        ("entropy", -0.1, "entropy: found -0.1, expected a finite number of at least 0"),
        ("tolfun", math.nan, "tolfun: found nan"),
        ("tolx", -1.0, "tolx: found -1.0"),
        ("floor", 0.5, "floor: found 0.5"),
        ("seed", 1.5, "seed: found 1.5"),
    ],
)
def test_settings_out_of_range_are_refused(field: str, value: object, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        RoutingSettings(**{field: value})


@pytest.mark.parametrize(
    ("sources", "blocks", "options", "expected"),
    [
        (("a",), BLOCKS, {}, r"sources: found \['a'\], expected at least two"),
        (("a", "a"), BLOCKS, {}, "sources: found 'a' more than once"),
        (names(3), (), {}, "blocks: found none"),
        (names(3), BLOCKS, {"constraints": Constraints(largest=2)}, r"expected at most 2 \(largest\)"),
        (names(3), BLOCKS, {"constraints": Constraints(frozen_blocks=("hed",))}, "did you mean 'head'"),
        (names(3), BLOCKS, {"start": Recipe.equal(names(5), BLOCKS)}, "start: unknown source 'source3'"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(sources, blocks, options, expected) -> None:
    scorer = Scorer(bowl)
    with pytest.raises(InputError, match=expected):
        RoutingSearch(sources, blocks, scorer, **options)
    assert scorer.calls == []
