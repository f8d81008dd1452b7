"""What a store knows of a pool and a benchmark before a search begins."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import write_pairs, write_pool

import sfkit
from sfkit.editing.hand_edits import mark_hand_edit
from sfkit.evaluation.known import known_evaluations
from sfkit.evaluation.outcome import Outcome


@pytest.fixture
def world(tmp_path: Path) -> tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore]:
    write_pool(tmp_path / "pool")
    write_pairs(tmp_path / "pairs", 2)
    return (
        sfkit.open_pool(tmp_path / "pool"),
        sfkit.open_benchmark("pairs", tmp_path / "pairs"),
        sfkit.EvaluationStore(tmp_path / "evaluations.sqlite"),
    )


def test_recipes_come_back_with_names_scores_and_who_asked(
    world: tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore],
) -> None:
    pool, benchmark, store = world
    scorer = sfkit.Evaluator(pool, benchmark, store=store, metric="epe")
    one, other = pool.names[:2]
    edited = sfkit.routed((other, one), pool.blocks, [(0.75, 0.25)] * len(pool.blocks))
    outcomes = scorer([pool.equal(one, other), edited])
    mark_hand_edit(store, outcomes[1].key, benchmark)
    found = known_evaluations(pool, scorer, {"seed": 1})
    assert [entry.score for entry in found] == [outcome.score for outcome in outcomes]
    assert [entry.origin for entry in found] == ["search", "hand edit"]
    assert found[0].recipe == pool.equal(one, other)
    assert pool.canonical(found[1].recipe) == pool.canonical(edited)


def test_what_a_baseline_asked_for_first_is_told_apart(
    world: tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore],
) -> None:
    pool, benchmark, store = world
    scorer = sfkit.Evaluator(pool, benchmark, store=store, metric="epe")
    searched, edited, single = (pool.equal(name) for name in pool.names[:3])
    scorer([searched])
    found = sfkit.baselines.single_best(pool, scorer)
    assert found.evaluations == len(pool.names)
    (outcome,) = scorer([edited])
    mark_hand_edit(store, outcome.key, benchmark)
    sfkit.baselines.single_best(pool, scorer)  # all from the store: nothing is marked again
    origins = {entry.recipe: entry.origin for entry in known_evaluations(pool, scorer, {"seed": 1})}
    assert (origins[searched], origins[edited], origins[single]) == ("search", "hand edit", "baseline")
    assert set(origins) == {pool.equal(name) for name in pool.names}


def test_a_search_that_began_learns_from_what_there_was_then(
    world: tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore],
) -> None:
    pool, benchmark, store = world
    scorer = sfkit.Evaluator(pool, benchmark, store=store, metric="epe")
    scorer([pool.equal(*pool.names[:2])])
    before = known_evaluations(pool, scorer, {"seed": 1})
    scorer([pool.equal(*pool.names)])
    assert known_evaluations(pool, scorer, {"seed": 1}) == before
    assert len(known_evaluations(pool, scorer, {"seed": 2})) == 2


def test_another_benchmark_and_a_scorer_without_a_store_know_nothing(
    world: tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore],
) -> None:
    pool, benchmark, store = world
    scorer = sfkit.Evaluator(pool, benchmark, store=store, metric="epe")
    scorer([pool.equal(*pool.names[:2])])
    half = sfkit.Evaluator(pool, benchmark.first(1), store=store, metric="epe")
    assert known_evaluations(pool, half, {}) == ()
    assert known_evaluations(pool, lambda recipes: [Outcome(1.0) for _ in recipes], {}) == ()


def test_of_several_benchmarks_what_all_know_is_combined(
    world: tuple[sfkit.Pool, sfkit.Benchmark, sfkit.EvaluationStore],
) -> None:
    pool, benchmark, store = world
    parts = [
        sfkit.Evaluator(pool, part, store=store, metric="epe") for part in (benchmark, benchmark.first(1))
    ]
    both = sfkit.CombinedScorer(parts)
    (outcome,) = both([pool.equal(*pool.names[:2])])
    parts[0]([pool.equal(*pool.names)])
    (known,) = known_evaluations(pool, both, {})
    assert known.score == outcome.score
