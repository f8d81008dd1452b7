"""Paired bootstrap: against every possible resampling, against coverage by simulation, and its sentences."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_records import image, measured

from sfkit.analysis import Measured, Resampling, Spread, paired_difference, seed_spread
from sfkit.errors import InputError


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def every_resampling(ours: Sequence[float], theirs: Sequence[float], sizes: Sequence[float]) -> np.ndarray:
    """The differences of ratios of sums over all n^n equally likely draws."""
    found = []
    for drawn in itertools.product(range(len(ours)), repeat=len(ours)):
        below = sum(sizes[n] for n in drawn)
        found.append(sum(ours[n] - theirs[n] for n in drawn) / below)
    return np.array(found)


@pytest.mark.parametrize(("protocol", "family"), [("all-valid", "pairs"), ("raft", "kitti")])
def test_the_interval_is_that_of_all_resamplings(protocol: str, family: str) -> None:
    pixels, bad = [100, 400, 50, 300, 120], {"a": [10, 90, 5, 60, 12], "b": [20, 80, 9, 66, 30]}
    one = measured(bad, pixels=pixels, protocol=protocol, family=family)
    found = paired_difference(one, "a", "b", rng(), resamples=200_000)
    if protocol == "raft":  # pooled over pixels
        ours, theirs = (np.multiply(100.0, bad[n]) for n in "ab")
        exact = every_resampling(ours, theirs, pixels)
        assert found.value == pytest.approx(100.0 * (177 - 205) / 970)
    else:  # the mean over images
        ours, theirs = (100.0 * np.divide(bad[n], pixels) for n in "ab")
        exact = every_resampling(ours, theirs, [1.0] * 5)
        assert found.value == pytest.approx(np.mean(ours - theirs))
    assert found.interval == pytest.approx(np.percentile(exact, [2.5, 97.5]), abs=0.05)
    assert found.images == (5,)
    assert found.few


def test_the_value_is_the_difference_of_the_protocols_scores() -> None:
    one = measured({"a": [1, 50], "b": [2, 7]}, pixels=[10, 500], protocol="raft", family="kitti")
    assert one.score("a") == pytest.approx(100 * 51 / 510)
    found = paired_difference(one, "a", "b", rng())
    assert found.value == pytest.approx(one.score("a") - one.score("b"))
    assert one.score("a", metric="epe") == 0.0


def test_95_percent_intervals_hold_the_truth_about_95_times_of_100() -> None:
    # 300 benchmarks of 40 images each, drawn from one population in which a is 2.0 points better than b.
    draw = rng(3)
    held = 0
    for _ in range(300):
        hard = draw.normal(40.0, 15.0, 40)
        gain = draw.normal(2.0, 5.0, 40)
        pixels = [10**6] * 40
        bad = {"a": hard - gain, "b": hard}
        counts = {n: [round(10**4 * float(v)) for v in values] for n, values in bad.items()}
        found = paired_difference(measured(counts, pixels=pixels), "a", "b", draw, resamples=400)
        assert found.interval is not None
        held += found.interval[0] <= -2.0 <= found.interval[1]
    assert 270 <= held <= 296


def test_pairing_removes_what_makes_images_hard_for_both() -> None:
    one = measured({"a": [5, 35, 65, 90] * 3, "b": [6, 36, 66, 91] * 3})
    found = paired_difference(one, "a", "b", rng())
    assert found.interval == pytest.approx((-1.0, -1.0))
    assert found.within_noise is False
    assert str(found) == "better than b: -1.00 [-1.00, -1.00] %"


def test_means_over_benchmarks_weigh_each_alike_and_resample_within_it() -> None:
    first = measured({"a": [10, 30], "b": [0, 0]}, name="one")
    second = measured({"a": [0, 0, 0, 100], "b": [0, 0, 0, 0]}, name="two")
    found = paired_difference([first, second], "a", "b", rng(), resamples=200_000)
    assert found.value == pytest.approx((20.0 + 25.0) / 2)
    draws = [
        (np.mean(x) + np.mean(y)) / 2
        for x in itertools.product([10, 30], repeat=2)
        for y in itertools.product([0, 0, 0, 100], repeat=4)
    ]
    assert found.interval == pytest.approx(np.percentile(draws, [2.5, 97.5]), abs=0.2)
    assert found.images == (2, 4)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(*[st.integers(0, 100)] * 2), min_size=2, max_size=12),
    st.integers(0, 2**31),
)
def test_exchanging_both_networks_mirrors_the_interval(bad: list[tuple[int, int]], seed: int) -> None:
    one = measured({"a": [x for x, _ in bad], "b": [y for _, y in bad]})
    drawing = Resampling([one], rng(seed), resamples=50)
    there, back = drawing.difference("a", "b"), drawing.difference("b", "a")
    assert there.value == pytest.approx(-back.value)
    assert there.interval is not None
    assert back.interval is not None
    assert there.interval == pytest.approx((-back.interval[1], -back.interval[0]))
    assert drawing.difference("a", "a").interval == (0.0, 0.0)


def test_the_generator_decides_and_is_the_only_one_that_does() -> None:
    one = measured({"a": list(range(0, 90, 3)), "b": [2] * 30})
    np.random.seed(0)
    first = paired_difference(one, "a", "b", rng(5))
    np.random.seed(1)
    assert paired_difference(one, "a", "b", rng(5)) == first
    assert paired_difference(one, "a", "b", rng(6)) != first


def test_one_image_has_no_interval_and_says_so() -> None:
    found = paired_difference(measured({"a": [20], "b": [23]}), "a", "b", rng())
    assert found.interval is None
    assert found.within_noise is None
    assert str(found) == "at -3.00 % against b, no interval: one has one image"
    several = [measured({"a": [1, 2], "b": [3, 5]}, name="two"), measured({"a": [20], "b": [23]})]
    mean = paired_difference(several, "a", "b", rng())
    assert mean.value == pytest.approx((-2.5 - 3.0) / 2)
    assert mean.reason == "one has one image"


def test_failures_and_predictions_that_are_not_finite_have_no_interval() -> None:
    one = measured({"a": [], "b": [2, 3]})
    found = paired_difference(one, "a", "b", rng())
    assert math.isnan(found.value)
    assert found.reason == "a network failed on one"
    broken = Measured(
        "one",
        "all-valid",
        "pairs",
        "epe",
        False,
        {"a": (image("x", 9, 9, math.inf), image("y", 9, 0)), "b": (image("x", 9, 0, 9.0), image("y", 9, 0))},
    )
    found = paired_difference(broken, "a", "b", rng())
    assert found.value == math.inf
    assert found.reason == "a prediction on one is not finite"
    assert paired_difference(broken, "a", "a", rng()).value == 0.0


def test_sentences_say_noise_worse_and_few_images() -> None:
    one = measured({"a": [1, 3] * 10, "b": [2, 2] * 10, "c": [5, 5] * 10})
    assert str(paired_difference(one, "a", "b", rng())).startswith("within noise of b: +0.00 [-0.")
    assert str(paired_difference(one, "c", "b", rng())) == "worse than b: +3.00 [+3.00, +3.00] %"
    assert not paired_difference(one, "a", "b", rng()).few
    assert paired_difference(measured({"a": [1, 3], "b": [2, 2]}), "a", "b", rng()).few


def test_several_runs_are_averaged_before_they_are_compared() -> None:
    one = measured({"s0": [10, 20], "s1": [20, 40], "b": [10, 20]})
    found = paired_difference(one, ["s0", "s1"], "b", rng())
    assert found.value == pytest.approx(7.5)
    assert found.network == "mean of 2 runs"
    spread = seed_spread(one, ["s0", "s1"])
    assert spread.values == (15.0, 30.0)
    assert str(spread) == "22.50 ± 10.61 over 2 seeds (15.00 to 30.00)"
    assert str(Spread((1.5,))) == "1.50 from one seed"


def test_what_cannot_be_compared_is_refused() -> None:
    one = measured({"a": [1, 2], "b": [1, 2]})
    with pytest.raises(InputError, match="network measured on 'one'"):
        paired_difference(one, "a", "c", rng())
    with pytest.raises(InputError, match="expected at least one and each once"):
        Resampling([one, one], rng())
    with pytest.raises(InputError, match="0 resamples"):
        paired_difference(one, "a", "b", rng(), resamples=0)
    with pytest.raises(InputError, match="expected some of one"):
        Resampling([one], rng()).difference("a", "b", benchmarks=["two"])
    pixels = Measured("two", "all-valid", "pairs", "epe", False, one.images)
    with pytest.raises(InputError, match="expected one unit for a mean"):
        paired_difference([one, pixels], "a", "b", rng())
    assert paired_difference([one, pixels], "a", "b", rng(), metric="d1").value == 0.0
    with pytest.raises(InputError, match="expected the same images in one order"):
        Measured(
            "x", "all-valid", "pairs", "epe", False, {"a": (image("p", 1, 0),), "b": (image("q", 1, 0),)}
        )
    with pytest.raises(InputError, match="found no value"):
        Spread(())
