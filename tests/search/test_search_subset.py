"""Stage 1 against exhaustive search, and what makes it reproducible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_landscapes import (
    BLOCKS,
    Killed,
    Scorer,
    ShufflingScorer,
    StoredScorer,
    every_subset,
    names,
    subset_landscape,
)

from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import Constraints, SubsetSearch, SubsetSettings
from sfkit.search.breeding import bred, initial

SMALL = SubsetSettings(population=12, generations=6, seed=3)
TRUNCATING = replace(SMALL, survival="truncation")


def scorer_of(count: int, seed: int = 0, kind=Scorer):
    landscape = subset_landscape(count, seed)
    return kind(lambda recipe: landscape(recipe.sources))


def trace(search: SubsetSearch) -> list[tuple]:
    """Everything a search decides, without where scores came from."""
    rows = [(c.chromosome, c.parents, c.operators, c.score, c.repeated) for c in search.candidates]
    return [*rows, search.state.populations]


@pytest.mark.parametrize("seed", range(6))
def test_finds_the_optimum_where_sources_help_or_hurt_on_their_own(seed: int) -> None:
    worth = dict(zip(names(8), np.random.default_rng(seed).normal(size=8), strict=True))

    def landscape(subset) -> float:
        return math.fsum(worth[name] for name in subset)

    optimum = min(every_subset(8), key=landscape)
    scorer = Scorer(lambda recipe: landscape(recipe.sources))
    best = SubsetSearch(names(8), BLOCKS, scorer, SubsetSettings(seed=seed)).run()
    assert frozenset(best.subset) == optimum
    assert best.score == landscape(optimum)


@pytest.mark.parametrize("seed", range(6))
def test_ends_among_the_best_three_of_247_where_every_member_matters_to_every_other(seed: int) -> None:
    landscape = subset_landscape(8, seed)
    scores = sorted(landscape(subset) for subset in every_subset(8))
    assert len(scores) == 247
    best = SubsetSearch(names(8), BLOCKS, scorer_of(8, seed), SubsetSettings(seed=seed)).run()
    assert best.score == landscape(best.subset)
    assert best.score <= scores[2]


def test_candidates_are_equal_weight_merges_in_the_pools_order() -> None:
    search = SubsetSearch(names(6), BLOCKS, scorer_of(6), SMALL)
    search.run()
    for candidate in search.candidates:
        ordered = [name for name in names(6) if name in candidate.chromosome]
        assert candidate.recipe == Recipe.equal(ordered, BLOCKS)
        assert sorted(candidate.chromosome) == sorted(candidate.subset)


def test_populations_have_their_size_and_hold_the_best_of_their_pool() -> None:
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), SMALL)
    for generation in search:
        population = search.state.populations[-1]
        assert len(population) == SMALL.population
        pool = {*population, *(c.number for c in generation.candidates)}
        if generation.number > 0:
            pool |= set(search.state.populations[-2])
            assert min(search.candidates[i].rank for i in pool)[1] == population[-1]
            assert set(population) <= pool
    assert len(search.state.populations) == SMALL.generations + 1


def test_by_truncation_the_best_subsets_so_far_are_the_population() -> None:
    """What is not among the best of its pool once never is again: the population is the archive's head."""
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), TRUNCATING)
    for generation in search:
        if generation.number > 0:
            assert search.population == search.archive(SMALL.population)


def test_truncation_goes_on_where_there_are_fewer_subsets_than_places() -> None:
    search = SubsetSearch(names(3), BLOCKS, scorer_of(3), TRUNCATING)
    search.run()
    assert len(search.population) == search.counts.distinct == 4
    assert len(search.candidates) == 7 * SMALL.population


@pytest.mark.parametrize("chosen", [SMALL, TRUNCATING])
def test_parents_are_members_of_the_population_before(chosen: SubsetSettings) -> None:
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), chosen)
    search.run()
    for candidate in search.candidates:
        if candidate.generation == 0:
            assert candidate.parents == ()
        else:
            assert set(candidate.parents) <= set(search.state.populations[candidate.generation - 1])


def test_no_subset_is_scored_twice_and_a_generation_is_one_call() -> None:
    scorer = scorer_of(8)
    search = SubsetSearch(names(8), BLOCKS, scorer, SubsetSettings(seed=1))
    search.run()
    asked = [frozenset(recipe.sources) for recipe in scorer.asked]
    assert len(asked) == len(set(asked)) == search.counts.distinct
    assert len(scorer.calls) <= search.generation + 1
    assert all(scorer.calls)
    assert search.counts.candidates == 16 * 50
    assert search.counts.repeated == 800 - len(asked)
    assert search.counts.seconds == pytest.approx(0.5 * len(asked))


def test_the_same_seed_gives_the_same_search_and_another_another() -> None:
    runs = [SubsetSearch(names(8), BLOCKS, scorer_of(8), SubsetSettings(seed=s)) for s in (5, 5, 6)]
    for search in runs:
        search.run()
    assert trace(runs[0]) == trace(runs[1])
    assert trace(runs[0]) != trace(runs[2])


def test_the_order_of_an_engines_work_changes_nothing() -> None:
    searches = [
        SubsetSearch(names(8), BLOCKS, scorer_of(8, kind=k), SMALL) for k in (Scorer, ShufflingScorer)
    ]
    for search in searches:
        search.run()
    assert trace(searches[0]) == trace(searches[1])


def test_numpys_global_state_is_neither_read_nor_written() -> None:
    results = []
    for seed in (0, 1):
        np.random.seed(seed)
        before = np.random.get_state()
        search = SubsetSearch(names(8), BLOCKS, scorer_of(8), SMALL)
        search.run()
        after = np.random.get_state()
        assert np.array_equal(before[1], after[1])
        assert before[2:] == after[2:]
        results.append(trace(search))
    assert results[0] == results[1]


@given(st.integers(0, 60), st.sampled_from([SMALL, TRUNCATING]))
@settings(max_examples=24, deadline=None)
def test_killed_anywhere_and_started_again_it_repeats_nothing(lives: int, chosen: SubsetSettings) -> None:
    landscape = subset_landscape(7, 2)
    whole = SubsetSearch(names(7), BLOCKS, Scorer(lambda r: landscape(r.sources)), chosen)
    whole.run()
    store: dict = {}
    first = StoredScorer(lambda r: landscape(r.sources), store, lives)
    killed = lives < whole.counts.distinct
    try:
        SubsetSearch(names(7), BLOCKS, first, chosen).run()
        assert not killed
    except Killed:
        assert killed
    second = StoredScorer(lambda r: landscape(r.sources), store)
    again = SubsetSearch(names(7), BLOCKS, second, chosen)
    assert again.run().subset == whole.best.subset
    assert trace(again) == trace(whole)
    assert not set(first.computed) & set(second.computed)
    assert again.counts.cached == len(first.computed)
    assert again.counts.seconds_saved == pytest.approx(0.5 * len(first.computed))
    assert again.counts.seconds == pytest.approx(0.5 * len(second.computed))


def test_a_step_that_was_interrupted_can_be_taken_again() -> None:
    landscape = subset_landscape(7, 2)
    whole = SubsetSearch(names(7), BLOCKS, Scorer(lambda r: landscape(r.sources)), SMALL)
    whole.run()
    scorer = StoredScorer(lambda r: landscape(r.sources), {}, lives=20)
    search = SubsetSearch(names(7), BLOCKS, scorer, SMALL)
    with pytest.raises(Killed):
        search.run()
    before = search.state
    assert before.generation >= 0
    scorer.lives = math.inf
    search.run()
    assert trace(search) == trace(whole)
    assert search.candidates[: len(before.candidates)] == before.candidates


def test_generation_t_draws_from_seed_stage_and_t_alone() -> None:
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), SMALL)
    for t, generation in enumerate(search):
        rng = np.random.default_rng([SMALL.seed, 1, t])
        if t == 0:
            drafts = initial(SMALL, search.space, (), rng)
        else:
            members = [search.candidates[i] for i in search.state.populations[t - 1]]
            genes = [tuple(int(name[-1]) for name in c.chromosome) for c in members]
            drafts = bred(list(zip(genes, [c.rank for c in members], strict=True)), SMALL, search.space, rng)
        expected = [tuple(f"source{gene}" for gene in draft.chromosome) for draft in drafts]
        assert [candidate.chromosome for candidate in generation.candidates] == expected


def test_more_generations_begin_with_the_fewer() -> None:
    short, long = (
        SubsetSearch(names(8), BLOCKS, scorer_of(8), SubsetSettings(population=10, generations=t))
        for t in (3, 6)
    )
    short.run()
    long.run()
    assert long.candidates[: len(short.candidates)] == short.candidates


def test_failed_candidates_lose_are_recorded_and_not_tried_again() -> None:
    landscape = subset_landscape(8, 0)

    def score(recipe: Recipe) -> float:
        return math.inf if "source3" in recipe.sources else landscape(recipe.sources)

    scorer = Scorer(score)
    search = SubsetSearch(names(8), BLOCKS, scorer, SubsetSettings(population=20, generations=5))
    best = search.run()
    failed = search.history.query("failed")
    assert "source3" not in best.subset
    assert len(failed) > 0
    assert set(failed["error"]) == {"out of memory"}
    assert len(scorer.asked) == len(set(scorer.asked))
    assert search.counts.failed == sum("source3" in recipe.sources for recipe in scorer.asked)
    assert all("source3" not in candidate.subset for candidate in search.archive())


@pytest.mark.parametrize("bad", [math.nan, -math.inf, math.inf])
def test_scores_that_are_not_finite_lose(bad: float) -> None:
    landscape = subset_landscape(6, 0)

    class Odd(Scorer):
        def outcome(self, recipe: Recipe) -> Outcome:
            return Outcome(bad if len(recipe.sources) == 2 else landscape(recipe.sources))

    search = SubsetSearch(names(6), BLOCKS, Odd(lambda r: 0.0), SMALL)
    assert len(search.run().subset) > 2
    assert search.counts.failed > 0


def test_a_search_in_which_everything_failed_ends_and_says_why() -> None:
    search = SubsetSearch(names(5), BLOCKS, Scorer(lambda recipe: math.inf), SMALL)
    with pytest.raises(SfkitError, match="has a finite score, the first one's outcome was: out of memory"):
        search.run()
    assert search.done
    assert search.best is None
    assert search.archive() == ()


def test_ties_go_to_the_earlier_candidate() -> None:
    search = SubsetSearch(names(6), BLOCKS, Scorer(lambda recipe: 1.0), SMALL)
    assert search.run().number == 0
    assert [c.number for c in search.archive()] == sorted(c.number for c in search.archive())


def test_the_archive_is_unique_and_sorted() -> None:
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), SMALL)
    search.run()
    archive = search.archive()
    assert len({frozenset(c.subset) for c in archive}) == len(archive) == search.counts.distinct
    assert [c.score for c in archive] == sorted(c.score for c in archive)
    assert archive[0] == search.best
    assert search.archive(3) == archive[:3]


def test_history_has_a_row_a_candidate() -> None:
    search = SubsetSearch(names(8), BLOCKS, scorer_of(8), SMALL)
    empty = search.history
    search.run()
    history = search.history
    assert list(history.columns) == list(empty.columns)
    assert len(empty) == 0
    assert history["candidate"].tolist() == list(range(search.counts.candidates))
    assert history["generation"].max() == SMALL.generations
    assert (history["size"] == history["subset"].map(len)).all()
    assert history.query("generation == 0")["survived"].all()
    last = history.query("generation == @SMALL.generations and survived")["candidate"]
    assert set(last) <= set(search.state.populations[-1])
    assert history["score"].min() == search.best.score


def test_constraints_hold_for_every_candidate() -> None:
    limits = Constraints(include=("source2",), exclude=("source0", "source5"), largest=3)
    landscape = subset_landscape(8, 1)
    search = SubsetSearch(
        names(8), BLOCKS, scorer_of(8, 1), SubsetSettings(population=30, generations=8), constraints=limits
    )
    legal = [s for s in every_subset(8) if "source2" in s and not s & {"source0", "source5"} and len(s) <= 3]
    assert frozenset(search.run().subset) == min(legal, key=landscape)
    assert {frozenset(c.subset) for c in search.candidates} <= set(legal)
    assert search.space.subsets == len(legal)


def test_a_start_takes_the_first_places() -> None:
    recipe = Recipe.weighted({"source4": 0.5, "source1": 0.5, "source0": 0.0}, BLOCKS)
    search = SubsetSearch(
        names(6), BLOCKS, scorer_of(6), SMALL, start=[recipe, ("source5", "source2", "source0")]
    )
    search.step()
    assert [c.chromosome for c in search.candidates[:2]] == [
        ("source4", "source1"),
        ("source5", "source2", "source0"),
    ]
    assert search.candidates[0].subset == ("source1", "source4")
    assert search.candidates[0].operators == ("start",)
    alone = SubsetSearch(names(6), BLOCKS, scorer_of(6), SMALL, start=recipe)
    alone.step()
    assert alone.candidates[0].subset == ("source1", "source4")


def test_two_sources_have_one_subset() -> None:
    scorer = scorer_of(2)
    search = SubsetSearch(names(2), BLOCKS, scorer, SMALL)
    assert search.run().subset == names(2)
    assert len(scorer.asked) == 1


def test_zero_generations_score_the_initial_population_alone() -> None:
    search = SubsetSearch(names(5), BLOCKS, scorer_of(5), SubsetSettings(population=4, generations=0))
    search.run()
    assert search.generation == 0
    assert search.counts.candidates == 4


@pytest.mark.parametrize(
    ("sources", "blocks", "options", "expected"),
    [
        (("a",), BLOCKS, {}, "sources: found 1 that may take part"),
        ((), BLOCKS, {}, "sources: found 0 that may take part"),
        (("a", "b", "a"), BLOCKS, {}, "sources: found 'a' more than once"),
        ("ab", BLOCKS, {}, "sources: found the text 'ab'"),
        (("a", 3), BLOCKS, {}, "sources: found the entry 3"),
        (names(4), (), {}, "blocks: found none"),
        (names(4), BLOCKS, {"start": "source1"}, "start: found the text 'source1'"),
        (names(4), BLOCKS, {"start": ["source1", "source2"]}, "start: found the name 'source1'"),
        (
            names(4),
            BLOCKS,
            {"start": [["source1", "sourc2"]]},
            "unknown source 'sourc2'.*did you mean 'source2'",
        ),
        (
            names(4),
            BLOCKS,
            {"start": [["source1"]]},
            r"start: found the subset \['source1'\], expected 2 to 4",
        ),
        (names(9), BLOCKS, {"start": [names(2)] * 13}, "start: found 13 entries, expected at most 12"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(sources, blocks, options, expected) -> None:
    scorer = scorer_of(9)
    with pytest.raises(InputError, match=expected):
        SubsetSearch(sources, blocks, scorer, SMALL, **options)
    assert scorer.calls == []
