"""Disparity panels: hand-made maps, and scores that agree with the evaluator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny import write_pairs, write_pool

import sfkit
from sfkit.analysis.disparities import Comparison, disparity_panels
from sfkit.analysis.pair_maps import disparity_limits, error_map
from sfkit.datasets.benchmark import Benchmark, memory_benchmark, open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.network import load_network
from sfkit.merging.saving import save_merged


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pool, Benchmark]:
    folder: Path = tmp_path_factory.mktemp("world")
    pool = open_pool(write_pool(folder / "pool", sources=2))
    return pool, open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0")


def test_an_error_map_is_empty_without_truth_and_infinite_without_a_prediction() -> None:
    truth = np.array([[4.0, np.nan, 2.0, 1.0]], np.float32)
    prediction = np.array([[1.5, 3.0, np.nan, -np.inf]], np.float32)
    np.testing.assert_array_equal(error_map(prediction, truth), [[2.5, np.nan, np.inf, np.inf]])


def test_the_colour_range_leaves_out_one_percent_at_each_end() -> None:
    truth = np.concatenate([np.linspace(10.2, 19.6, 1000), [500.0, np.nan]]).astype(np.float32)
    assert disparity_limits(truth[None]) == (10.0, 20.0)
    assert disparity_limits(np.full((2, 2), 5.0, np.float32)) == (5.0, 6.0)
    with pytest.raises(InputError, match="found no valid pixel"):
        disparity_limits(np.full((2, 2), np.nan, np.float32))


def test_panels_agree_with_the_evaluator(world: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = world
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform()}
    panels = disparity_panels(pool, recipes, benchmark, pair="pair1", metrics=["bad-2.0", "epe"])
    evaluator = Evaluator(pool, benchmark.select(["pair1"]))
    for network, evaluation in zip(panels.networks, evaluator.evaluate(list(recipes.values())), strict=True):
        assert network.scores["bad-2.0"] == evaluation.images[0].value("bad-2.0")
        assert network.scores["epe"] == evaluation.images[0].value("epe")
        known = network.error[np.isfinite(network.error)]
        assert network.scores["epe"] == pytest.approx(known.mean(), rel=1e-5)
        assert network.scores["bad-2.0"] == pytest.approx(100 * (known > 2.0).mean())
    assert [network.name for network in panels.networks] == ["base", "uniform"]
    assert (panels.pair, panels.protocol, panels.threshold) == ("pair1", "all-valid", 2.0)
    assert panels.left.shape == (48, 96, 3)
    assert np.isnan(panels.truth[:, :5]).all()
    assert np.isnan(panels.networks[0].error[:, :5]).all()
    assert panels.limits == (5.0, 6.0)


def test_a_range_of_a_protocol_hides_the_truth_beyond_it(world: tuple[Pool, Benchmark]) -> None:
    """What does not count is not drawn as truth: ``openstereo`` on KITTI stops at 192 px."""
    pool, benchmark = world
    pair = benchmark.pairs[0].load()
    far = pair.disparity.copy()
    far[0, 10] = 300.0
    kitti = memory_benchmark(
        "far", [replace(pair, disparity=far)], family="kitti", protocol="openstereo", metric="epe"
    )
    panels = disparity_panels(pool, {"base": pool.base_recipe()}, kitti)
    assert np.isnan(panels.truth[0, 10])
    assert panels.truth[0, 11] == 5.0
    assert panels.threshold == 1.0


def test_unknown_pairs_and_empty_recipes_are_refused(world: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = world
    with pytest.raises(InputError, match="did you mean 'pair1'"):
        disparity_panels(pool, {"base": pool.base_recipe()}, benchmark, pair="pair11")
    with pytest.raises(InputError, match="recipes: found none"):
        disparity_panels(pool, {}, benchmark)


def test_a_comparison_runs_each_pair_once_and_takes_loaded_networks(
    world: tuple[Pool, Benchmark], tmp_path: Path
) -> None:
    pool, benchmark = world
    save_merged(pool, pool.uniform(), tmp_path / "uniform.safetensors")
    file = tmp_path / "uniform.safetensors"
    networks = {"recipe": pool.uniform(), "file": load_network(file), "model": sfkit.load(file)}
    comparison = Comparison(pool, networks, benchmark)
    assert comparison.pairs == ("pair0", "pair1")
    first = comparison.panels()
    assert comparison.panels("pair1").pair == "pair1"
    assert comparison.panels("pair0") is first
    recipe, *files = first.networks
    for same in files:
        np.testing.assert_array_equal(recipe.disparity, same.disparity)
        assert recipe.scores == same.scores


def test_a_recipe_of_another_pool_is_refused_before_anything_runs(world: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = world
    with pytest.raises(InputError, match="'elsewhere'"):
        Comparison(pool, {"odd": Recipe.equal(["elsewhere"], pool.blocks)}, benchmark)
