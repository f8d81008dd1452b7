"""Paired t intervals: against scipy's own test, by simulated coverage, with seeds, and Holm by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sfkit.analysis.intervals import RunsOnImages, holm, paired_estimate
from sfkit.errors import InputError

Draw = Callable[[np.random.Generator, tuple[int, ...]], NDArray[np.float64]]

POPULATIONS: dict[str, tuple[Draw, float]] = {
    "normal": (lambda rng, shape: rng.normal(0.0, 1.0, shape), 0.95),
    "heavy tails": (lambda rng, shape: rng.standard_t(3, shape), 0.95),
    "skewed": (lambda rng, shape: rng.exponential(1.0, shape) - 1.0, 0.90),
}


def fixed(values: object) -> RunsOnImages:
    return RunsOnImages(np.atleast_2d(np.asarray(values, dtype=np.float64)))


def test_two_networks_are_compared_as_scipys_paired_t_test_does() -> None:
    rng = np.random.default_rng(2)
    ours, theirs = rng.normal(3.0, 1.0, 9), rng.normal(3.5, 1.0, 9)
    found = paired_estimate([(fixed(ours), fixed(theirs))])
    peer = scipy.stats.ttest_rel(ours, theirs)
    assert found.value == pytest.approx(np.mean(ours - theirs))
    assert found.p == pytest.approx(peer.pvalue)
    low, high = peer.confidence_interval(0.95)
    assert found.interval() == pytest.approx((low, high))


def test_a_mean_of_two_benchmarks_is_welchs_test() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.normal(0.3, 1.0, 7), rng.normal(-0.2, 4.0, 12)
    zero = [(fixed(x), fixed(np.zeros_like(x))) for x in (first, -second)]
    found = paired_estimate(zero)
    peer = scipy.stats.ttest_ind(first, second, equal_var=False)
    assert found.value == pytest.approx((first.mean() - second.mean()) / 2)
    assert found.p == pytest.approx(peer.pvalue)
    assert found.freedom == pytest.approx(peer.df)


def test_scores_pooled_over_pixels_are_linearised() -> None:
    # Jackknife: the same first order in n, computed image by image.
    rng = np.random.default_rng(4)
    below = rng.uniform(50.0, 500.0, 200)
    above = rng.uniform(0.0, 1.0, 200) * below
    found = paired_estimate([(RunsOnImages.of_terms(above[None], below), fixed(np.zeros(200)))])
    assert found.value == pytest.approx(above.sum() / below.sum())
    left_out = (above.sum() - above) / (below.sum() - below)
    jackknife = math.sqrt(199 / 200 * ((left_out - left_out.mean()) ** 2).sum())
    assert found.error == pytest.approx(jackknife, rel=0.02)


@pytest.mark.parametrize("images", [3, 5, 8, 15, 27, 40])
@pytest.mark.parametrize("population", POPULATIONS)
def test_95_percent_intervals_hold_the_truth_as_often_as_they_say(population: str, images: int) -> None:
    draw, least = POPULATIONS[population]
    rows = draw(np.random.default_rng(5), (1500, images))
    held = 0
    for row in rows:
        low, high = paired_estimate([(fixed(row), fixed(np.zeros(images)))]).interval()
        held += low <= 0.0 <= high
    slack = 0.02 if population != "skewed" else 0.04  # of a Monte Carlo of 1,500: 0.012
    assert held / len(rows) >= least - slack


def test_the_percentile_bootstrap_does_not() -> None:
    rng = np.random.default_rng(6)
    rows = rng.normal(0.0, 1.0, (600, 5))
    drawn = rows[:, rng.integers(0, 5, (400, 5))].mean(axis=2)
    low, high = np.percentile(drawn, [2.5, 97.5], axis=1)
    assert np.mean((low <= 0.0) & (high >= 0.0)) < 0.88


@pytest.mark.parametrize(("noise", "images", "runs"), [(1.0, 8, 5), (0.3, 27, 3), (0.0, 15, 5)])
def test_intervals_with_seeds_hold_the_mean_over_images_and_seeds(
    noise: float, images: int, runs: int
) -> None:
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(1000):
        seeds = rng.normal(0.0, noise, (runs, 1))
        hard = rng.normal(0.0, 1.0, images)
        both = rng.normal(0.0, 0.5, (runs, images))
        found = paired_estimate([(RunsOnImages(seeds + hard + both), fixed(np.zeros(images)))])
        low, high = found.interval()
        held += low <= 0.0 <= high
    assert 0.925 <= held / 1000 <= 0.995


def test_seeds_that_differ_widen_the_interval() -> None:
    images = np.linspace(-1.0, 1.0, 10)
    alike = RunsOnImages(np.stack([images, images, images]))
    apart = RunsOnImages(np.stack([images - 1.0, images, images + 1.0]))
    zero = fixed(np.zeros(10))
    narrow, wide = paired_estimate([(alike, zero)]), paired_estimate([(apart, zero)])
    assert narrow.value == pytest.approx(wide.value)
    assert narrow.error == pytest.approx(np.std(images, ddof=1) / math.sqrt(10))
    assert wide.error == pytest.approx(math.sqrt(narrow.error**2 + 1.0 / 3.0))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 2), min_size=2, max_size=12))
def test_exchanging_both_networks_mirrors_the_interval(rows: list[tuple[float, float]]) -> None:
    ours, theirs = (fixed(column) for column in zip(*rows, strict=True))
    there, back = paired_estimate([(ours, theirs)]), paired_estimate([(theirs, ours)])
    assert there.value == pytest.approx(-back.value, abs=1e-12)
    assert there.interval() == pytest.approx([-x for x in reversed(back.interval())], abs=1e-9)
    assert paired_estimate([(ours, ours)]).interval() == (0.0, 0.0)
    assert paired_estimate([(ours, ours)]).p == 1.0


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holm_only_raises_p_values_keeps_their_order_and_bonferroni_bounds_it(found: list[float]) -> None:
    adjusted = holm(found)
    order = np.argsort(found, kind="stable")
    assert all(a >= p for a, p in zip(adjusted, found, strict=True))
    assert all(a <= min(1.0, len(found) * p) + 1e-15 for a, p in zip(adjusted, found, strict=True))
    assert np.all(np.diff(np.array(adjusted)[order]) >= 0)


def test_holm_by_hand() -> None:
    # Ascending 0.005 x 4, 0.01 x 3, 0.03 x 2, 0.04 x 1, each at least the one before.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx((0.03, 0.06, 0.06, 0.02))
    adjusted = holm([0.5, math.nan, 0.01])
    assert adjusted[0] == 0.5
    assert math.isnan(adjusted[1])
    assert adjusted[2] == pytest.approx(0.02)


def test_with_no_difference_anywhere_a_table_claims_one_in_at_most_five_percent() -> None:
    # 8 images, 44 probes that share them (11 sources x 4 blocks), none of which changes anything.
    rng = np.random.default_rng(8)
    claimed = plain = 0
    for _ in range(400):
        shared = rng.normal(0.0, 1.0, 8)
        found = [
            paired_estimate([(fixed(shared + rng.normal(0.0, 1.0, 8)), fixed(shared))]).p for _ in range(44)
        ]
        plain += min(found) < 0.05
        claimed += min(holm(found)) < 0.05
    assert plain / 400 > 0.6
    assert claimed / 400 <= 0.075


def test_what_cannot_be_estimated_is_refused() -> None:
    with pytest.raises(InputError, match="found no benchmark"):
        paired_estimate([])
    with pytest.raises(InputError, match="1 and 1 images"):
        paired_estimate([(fixed([1.0]), fixed([2.0]))])
    with pytest.raises(InputError, match="3 and 2 images"):
        paired_estimate([(fixed([1.0, 2.0, 3.0]), fixed([2.0, 1.0]))])
    with pytest.raises(InputError, match="between 0 and 1"):
        paired_estimate([(fixed([1.0, 2.0]), fixed([2.0, 1.0]))]).interval(95.0)
