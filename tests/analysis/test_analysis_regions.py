"""Errors by region: textureless pixels by hand, other regions against what evaluations keep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flat_world import SIZE, calls, flat_pool

from sfkit.analysis import region_scores, textureless_mask
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator


def test_a_pixel_has_no_texture_where_the_window_hardly_changes() -> None:
    image = np.full((9, 12, 3), 100, np.uint8)
    assert textureless_mask(image).all()
    image[:, 6:] = 106  # a step of 6 between columns 5 and 6: 36 / 3 = 12 in the windows that hold it
    mask = textureless_mask(image)
    assert not mask[:, 4:7].any()
    assert mask[:, :4].all()
    assert mask[:, 7:].all()
    image[:, 6:] = 103  # a step of 3: 9 / 3 = 3 is below 4
    assert textureless_mask(image).all()
    assert not textureless_mask(image, limit=2.0)[:, 4:7].any()
    stripes = np.zeros((9, 12, 3), np.uint8)
    stripes[::2] = 200  # texture along columns alone does not help to match along rows
    assert textureless_mask(stripes).all()


def halves(name: str) -> Sample:
    """Left half without texture and 5 px away, right half with texture and 9 px away; a column occluded."""
    rng = np.random.default_rng(0)
    height, width = SIZE
    left = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    left[:, : width // 2] = 100
    right = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    disparity = np.full(SIZE, 5.0, np.float32)
    disparity[:, width // 2 :] = 9.0
    seen = np.ones(SIZE, np.bool_)
    seen[:, -6:] = False
    return Sample(name, left, right, disparity, seen)


def test_regions_are_scored_apart_and_textureless_ones_kept_in_the_store(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool")
    pairs = memory_benchmark("halves", [halves("x"), halves("y")], metric="epe")
    recipes = {"base": pool.base_recipe(), "high": pool.equal("high")}
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        evaluator = Evaluator(pool, pairs, store=store)
        plain = evaluator.evaluate(list(recipes.values()))
        found = region_scores(evaluator, recipes)
        assert found.regions == ("all", "visible", "occluded", "edge", "textureless")
        by_name = dict(zip(found.regions, found.values.T, strict=True))
        np.testing.assert_allclose(by_name["all"], [2.0, 5.0])  # base says 5: 0 left, 4 right
        np.testing.assert_allclose(by_name["occluded"], [4.0, 3.0])
        np.testing.assert_allclose(by_name["visible"], [24 * 4 / 54, (30 * 7 + 24 * 3) / 54])
        # The window at the border looks one column into the texture: column 29 is not without it.
        np.testing.assert_allclose(by_name["textureless"], [0.0, 7.0])
        shares = dict(zip(found.regions, found.shares, strict=True))
        assert shares["all"] == 100.0
        assert shares["occluded"] == pytest.approx(10.0)
        assert shares["textureless"] == pytest.approx(100 * 28 / 60)
        passes = len(calls)
        again = region_scores(evaluator, recipes)
        np.testing.assert_array_equal(again.values, found.values)
        assert len(calls) == passes
        assert evaluator.evaluate(list(recipes.values()))[0].images == plain[0].images
    grid = found.grid()
    assert grid.benchmarks[4] == "textureless, 46.7 % of pixels"
    assert grid.networks == ("base", "high")


def test_regions_the_data_cannot_tell_and_networks_that_failed(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    whole = halves("x")
    blind = memory_benchmark(
        "blind", [Sample("x", whole.right, whole.right[::-1].copy(), whole.disparity)], metric="epe"
    )
    found = region_scores(Evaluator(pool, blind), {"wild": pool.equal("wild"), "base": pool.base_recipe()})
    assert found.regions == ("all", "edge", "textureless")
    assert np.isnan(found.values[0]).all()
    assert np.isnan(found.values[1, 2])  # noise everywhere: not one pixel without texture
    assert found.shares[2] == 0.0
    with pytest.raises(InputError, match="found no recipe"):
        region_scores(Evaluator(pool, blind), {})
