"""Better and worse between two networks, and regions of outliers, on maps made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from tiny import write_pairs, write_pool

from sfkit.analysis.differences import advantage, advantage_table, outlier_regions
from sfkit.analysis.disparities import Comparison
from sfkit.analysis.pair_maps import error_map
from sfkit.datasets.benchmark import open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.evaluation.metrics import bad
from sfkit.merging import open_pool


def flat(height: int = 60, width: int = 100) -> NDArray[np.float32]:
    return np.zeros((height, width), np.float32)


def test_negative_is_nearer_to_the_truth() -> None:
    reference = np.array([[3.0, 0.5, np.nan, np.inf, np.inf, 1.0]], np.float32)
    network = np.array([[0.5, 2.5, np.nan, 2.0, np.inf, np.inf]], np.float32)
    found = advantage(reference, network, 1.0)
    np.testing.assert_array_equal(found.difference, [[-2.5, 2.0, np.nan, -np.inf, 0.0, np.inf]])
    assert found.fixed == pytest.approx(100 * 1 / 5)
    assert found.broken == pytest.approx(100 * 2 / 5)


disparities = arrays(np.float32, (4, 6), elements=st.floats(0, 20, width=32))


@given(truth=disparities, first=disparities, second=disparities)
def test_fixed_and_broken_explain_the_difference_of_the_metric(
    truth: NDArray[np.float32], first: NDArray[np.float32], second: NDArray[np.float32]
) -> None:
    truth = np.where(truth > 15, np.float32(np.nan), truth + np.float32(0.5))
    if np.isnan(truth).all():
        return
    found = advantage(error_map(first, truth), error_map(second, truth), 2.0)
    swapped = advantage(error_map(second, truth), error_map(first, truth), 2.0)
    change = bad(second, truth, 2.0) - bad(first, truth, 2.0)
    assert found.broken - found.fixed == pytest.approx(change, abs=1e-6)
    np.testing.assert_array_equal(found.difference, -swapped.difference)
    assert (found.fixed, found.broken) == (swapped.broken, swapped.fixed)


def test_maps_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(InputError, match=r"found shapes \(2, 2\) and \(2, 3\)"):
        advantage(flat(2, 2), flat(2, 3), 1.0)
    with pytest.raises(InputError, match="no pixel that counts in both"):
        advantage(np.full((2, 2), np.nan, np.float32), flat(2, 2), 1.0)


def test_a_region_is_its_box_its_size_and_its_worst_pixel() -> None:
    error = flat()
    error[10:14, 20:26] = 3.0
    error[12, 23] = 7.0
    (region,) = outlier_regions(error, 1.0)
    assert (region.x, region.y, region.width, region.height) == (20, 10, 6, 4)
    assert (region.pixels, region.above, region.worst, region.peak) == (24, 1.0, 7.0, (23, 12))
    assert region.mean == pytest.approx((23 * 3 + 7) / 24)


def test_the_threshold_itself_is_not_beyond_it() -> None:
    assert outlier_regions(np.full((20, 20), 1.0, np.float32), 1.0) == ()
    assert len(outlier_regions(np.full((20, 20), 1.01, np.float32), 1.0)) == 1


@pytest.mark.parametrize(("between", "regions"), [(4, 1), (5, 2)])
def test_pixels_a_small_gap_apart_belong_together(between: int, regions: int) -> None:
    error = flat()
    error[5:10, 10:15] = 2.0
    error[5:10, 14 + between : 19 + between] = 2.0
    assert len(outlier_regions(error, 1.0)) == regions


def test_sparse_truth_still_makes_regions() -> None:
    error = np.full((60, 100), np.nan, np.float32)
    error[::3, ::3] = 0.0
    error[12:24:3, 30:45:3] = 5.0
    (region,) = outlier_regions(error, 1.0)
    assert (region.pixels, region.x, region.y) == (20, 30, 12)


def test_the_largest_comes_first_and_specks_are_left_out() -> None:
    error = flat()
    error[0:3, 0:3] = 2.0
    error[30:40, 30:40] = 2.0
    error[50, 90:97] = 9.0
    assert [region.pixels for region in outlier_regions(error, 1.0)] == [100, 9]
    assert [region.pixels for region in outlier_regions(error, 1.0, most=1)] == [100]


def test_a_region_over_the_whole_image_is_split_at_twice_the_threshold() -> None:
    error = np.full((60, 100), 1.5, np.float32)
    error[5:10, 5:10] = 3.0
    error[40:50, 80:90] = 5.0
    regions = outlier_regions(error, 1.0)
    assert [(region.x, region.pixels, region.above) for region in regions] == [(80, 100, 2.0), (5, 25, 2.0)]


def test_a_wide_region_that_nothing_splits_stays_whole() -> None:
    error = flat()
    error[30, 5:95] = 1.5
    (region,) = outlier_regions(error, 1.0)
    assert (region.width, region.above) == (90, 1.0)


def test_a_broken_prediction_is_one_infinite_region() -> None:
    (region,) = outlier_regions(np.full((30, 30), np.inf, np.float32), 1.0)
    assert (region.pixels, region.worst, region.mean) == (900, math.inf, math.inf)


def test_a_threshold_is_above_zero() -> None:
    with pytest.raises(InputError, match=r"threshold: found 0\.0, expected more than 0 pixels"):
        outlier_regions(flat(), 0.0)


def test_the_table_agrees_with_the_metric_on_every_pair(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path / "pool", sources=2))
    benchmark = open_benchmark("pairs", write_pairs(tmp_path / "pairs"), metric="bad-2.0")
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform()}
    comparison = Comparison(pool, recipes, benchmark)
    table = advantage_table(comparison, "base", "uniform")
    assert sorted(table.index) == ["pair0", "pair1"]
    assert table["change"].is_monotonic_increasing
    evaluations = Evaluator(pool, benchmark).evaluate(list(recipes.values()))
    for number, pair in enumerate(benchmark.ids):
        base, uniform = (evaluation.images[number].value("bad-2.0") for evaluation in evaluations)
        assert table.loc[pair, "change"] == pytest.approx(uniform - base)
    with pytest.raises(InputError, match=r"unknown network 'uniforme'.*did you mean 'uniform'"):
        advantage_table(comparison, "base", "uniforme")
