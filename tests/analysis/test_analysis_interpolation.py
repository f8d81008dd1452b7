"""Interpolation: the straight line in parameters, both ends exact, scores that are known by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import benchmark, flat_pool
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny import write_pool

from sfkit.analysis import InterpolationCurve, interpolated, interpolation_curves
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.merging import Pool, Recipe, open_pool

BLOCKS = ("one", "two")


@st.composite
def recipes(draw: st.DrawFn, sources: tuple[str, ...]) -> Recipe:
    rows = []
    for _ in BLOCKS:
        raw = [draw(st.floats(0.0, 1.0)) + 1e-3 for _ in sources]
        rows.append(tuple(value / sum(raw) for value in raw))
    scales = tuple(draw(st.floats(0.25, 1.75)) for _ in BLOCKS)
    return Recipe(sources, BLOCKS, tuple(rows), scales)


def coefficient(recipe: Recipe, block: str, source: str) -> float:
    weights, scale = recipe.of(block)
    return weights.get(source, 0.0) * scale


@settings(max_examples=50, deadline=None)
@given(recipes(("a", "b")), recipes(("b", "c")), st.floats(0.0, 1.0))
def test_coefficients_lie_on_the_straight_line_and_weights_stay_convex(
    start: Recipe, end: Recipe, position: float
) -> None:
    between = interpolated(start, end, position)
    for block in BLOCKS:
        for source in "abc":
            expected = (1 - position) * coefficient(start, block, source)
            expected += position * coefficient(end, block, source)
            assert coefficient(between, block, source) == pytest.approx(expected, abs=1e-12)
        assert sum(between.of(block)[0].values()) == pytest.approx(1.0)


def test_both_ends_are_the_recipes_themselves() -> None:
    start = Recipe(("a", "b"), BLOCKS, ((0.25, 0.75), (0.5, 0.5)), (1.0, 0.5))
    end = Recipe(("b", "c"), BLOCKS, ((1.0, 0.0), (0.5, 0.5)), (1.75, 0.0))
    for position, recipe in ((0.0, start), (1.0, end)):
        found = interpolated(start, end, position)
        for block in BLOCKS:
            weights, scale = found.of(block)
            assert {k: v for k, v in weights.items() if v} == pytest.approx(
                {k: v for k, v in recipe.of(block)[0].items() if v}
            )
            assert scale == pytest.approx(recipe.of(block)[1])


def test_from_the_base_the_line_is_task_arithmetic_of_one_source() -> None:
    end = Recipe.equal(["a"], BLOCKS)
    assert interpolated(Recipe.base(BLOCKS), end, 0.25) == Recipe.weighted({"a": 0.25}, BLOCKS)
    assert interpolated(Recipe.base(BLOCKS), end, 1.5) == Recipe.weighted({"a": 1.5}, BLOCKS)
    assert interpolated(Recipe.base(BLOCKS), end, 0.0).weights == ((0.0,), (0.0,))


def test_merged_parameters_are_the_mean_of_both_ends(tmp_path: Path) -> None:
    pool: Pool = open_pool(write_pool(tmp_path / "pool", sources=2))
    start, end = pool.base_recipe(), pool.equal("a", "b")
    merged = {
        at: pool.merge_into(interpolated(start, end, at), torch.empty(pool.layout.size))
        for at in (0.0, 0.5, 1.0)
    }
    torch.testing.assert_close(merged[0.5], (merged[0.0] + merged[1.0]) / 2)


def test_what_is_no_line_is_refused() -> None:
    with pytest.raises(InputError, match="expected two recipes of one pool and partition"):
        interpolated(Recipe.base(BLOCKS), Recipe.base(["one"]), 0.5)
    with pytest.raises(InputError, match="negative weight"):
        interpolated(Recipe.equal(["a"], BLOCKS), Recipe.equal(["b"], BLOCKS), 1.2)


def test_scores_along_the_line_are_those_of_hand(tmp_path: Path) -> None:
    # The base says 5 px, "high" 12 px, and the truth is 8 px: errors |5 + 7 t - 8|.
    pool = flat_pool(tmp_path)
    evaluator = Evaluator(pool, benchmark("flat", (8.0,), metric="epe"))
    curves = interpolation_curves(
        [evaluator],
        {"high": (pool.base_recipe(), pool.equal("high")), "low": (pool.base_recipe(), pool.equal("low"))},
        positions=[0.0, 0.5, 1.0],
        validation=["flat"],
    )
    assert [curve.name for curve in curves] == ["high", "low"]
    np.testing.assert_allclose(curves[0].scores, [3.0, 0.5, 4.0])
    np.testing.assert_allclose(curves[1].scores, [3.0, 3.5, 4.0])
    assert curves[0].best == 0.5
    assert curves[0].barrier == 0.0
    assert evaluator.counts.computed == 5


def test_a_ridge_between_both_ends_is_a_barrier() -> None:
    at = np.array([0.0, 0.5, 1.0, 1.5])
    curve = InterpolationCurve("a", "x", "epe", "px", False, at, np.array([1.0, 5.0, 3.0, 99.0]))
    assert curve.barrier == pytest.approx(3.0)
    broken = InterpolationCurve("a", "x", "epe", "px", False, at, np.full(4, np.nan))
    assert np.isnan(broken.best)


def test_positions_without_both_ends_are_refused() -> None:
    with pytest.raises(InputError, match="ascending positions with 0 and 1"):
        interpolation_curves([], {"a": (Recipe.base(BLOCKS), Recipe.base(BLOCKS))}, positions=[0.0, 0.5])
