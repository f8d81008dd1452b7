"""Stage 2 in numbers: the incumbent by hand, the search against its journal, and which points are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.errors import InputError
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import Journal, RoutingSearch, RoutingSettings, read_journal

SOURCES, BLOCKS = ("a", "b", "c"), ("one", "two")


def trace_of(penalised: Sequence[float], generation: Sequence[int] | None = None) -> RoutingTrace:
    n = len(penalised)
    return RoutingTrace(
        sources=SOURCES,
        blocks=BLOCKS,
        gamma=(0.25, 1.75),
        metric=None,
        generation=np.array(generation if generation is not None else [0] * n),
        score=np.array(penalised),
        penalised=np.array(penalised),
        weights=np.full((n, 2, 3), 1 / 3),
        scales=np.ones((n, 2)),
        sigma=np.full(n, 0.5),
        axes=np.full((n, 5), 0.5),
    )


def score(recipes: Sequence[Recipe]) -> list[Outcome]:
    """A bowl around uneven weights; heavy use of ``c`` fails."""
    outcomes = []
    for recipe in recipes:
        (a, b, c), scale = recipe.weights[0], recipe.scales[0]
        failed = "too much of c" if c > 0.5 else None
        outcomes.append(Outcome(math.inf if failed else (a - 0.7) ** 2 + b + abs(scale - 1.2), error=failed))
    return outcomes


def test_the_incumbent_is_the_best_so_far_and_ties_go_to_the_earlier() -> None:
    assert trace_of([math.inf, 3.0, 5.0, 2.0, 2.0, math.inf]).incumbent.tolist() == [-1, 1, 1, 3, 3, 3]
    assert trace_of([math.inf]).best == -1


def test_a_trace_is_tied_until_two_blocks_differ() -> None:
    trace = trace_of([1.0, 2.0])
    assert trace.tied
    trace.weights[1, 1] = (0.5, 0.25, 0.25)
    assert not trace.tied


def test_one_point_an_iteration_and_the_last_evaluation() -> None:
    assert trace_of([1.0] * 7, [0, 1, 1, 1, 2, 2, 2]).iterations().tolist() == [0, 1, 4, 6]


@pytest.mark.parametrize("tied", [True, False])
def test_search_and_journal_tell_the_same(tmp_path: Path, tied: bool) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    settings = RoutingSettings(evaluations=30, tied=tied, seed=2)
    search = RoutingSearch(SOURCES, BLOCKS, score, settings, journal=journal)
    search.run()
    told, watched = routing_trace(search, metric="epe"), watched_routing(read_journal(journal.path))
    assert (told.sources, told.blocks, told.gamma) == (watched.sources, watched.blocks, watched.gamma)
    for name in ("generation", "score", "penalised", "weights", "scales", "sigma", "axes", "incumbent"):
        np.testing.assert_array_equal(getattr(told, name), getattr(watched, name), err_msg=name)
    assert told.tied is tied
    assert told.best == search.best.number  # type: ignore[union-attr]
    np.testing.assert_allclose(told.weights.sum(axis=2), 1.0)


def test_before_the_first_step_there_is_nothing_to_show() -> None:
    with pytest.raises(InputError, match=r"call step\(\) first"):
        routing_trace(RoutingSearch(SOURCES, BLOCKS, score))


def test_a_journal_without_a_routing_search_is_refused() -> None:
    with pytest.raises(InputError, match="no generation of a routing search"):
        watched_routing([])


@given(st.integers(0, 3000), st.lists(st.integers(0, 2999), max_size=300), st.integers(2, 400))
def test_drawn_points_are_few_ascending_and_keep_both_ends(count: int, keep: list[int], limit: int) -> None:
    inside = [k for k in keep if k < count]
    drawn = drawn_points(count, inside, limit).tolist()
    assert len(drawn) <= limit
    assert drawn == sorted(set(drawn))
    assert all(0 <= point < count for point in drawn)
    if count:
        assert (drawn[0], drawn[-1]) == (0, count - 1)
    if len(set(inside)) <= min(limit // 2, limit - 2) or count <= limit:
        assert set(inside) <= set(drawn)
