"""Differences of scores: values by hand, their words, reasons and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from measured_records import image, measured

from sfkit.analysis import Measured, Spread, corrected, paired_difference, seed_spread
from sfkit.errors import InputError


@pytest.mark.parametrize(("protocol", "family"), [("all-valid", "pairs"), ("raft", "kitti")])
def test_the_value_is_the_difference_of_the_protocols_scores(protocol: str, family: str) -> None:
    pixels, bad = [100, 400, 50, 300, 120], {"a": [10, 90, 5, 60, 12], "b": [20, 80, 9, 66, 30]}
    one = measured(bad, pixels=pixels, protocol=protocol, family=family)
    found = paired_difference(one, "a", "b")
    assert found.value == pytest.approx(one.score("a") - one.score("b"))
    assert found.images == (5,)
    if protocol == "raft":  # pooled over pixels
        assert found.value == pytest.approx(100.0 * (177 - 205) / 970)
    else:  # the mean over images: the paired t-test's interval
        ours, theirs = (100.0 * np.divide(bad[n], pixels) for n in "ab")
        peer = scipy.stats.ttest_rel(ours, theirs)
        assert found.interval == pytest.approx(tuple(peer.confidence_interval(0.95)))
        assert found.p == pytest.approx(peer.pvalue)


def test_pairing_removes_what_makes_images_hard_for_both() -> None:
    found = paired_difference(measured({"a": [5, 35, 65, 90] * 3, "b": [6, 36, 66, 91] * 3}), "a", "b")
    assert found.interval == pytest.approx((-1.0, -1.0))
    assert (found.within_noise, found.word) == (False, "better")
    assert str(found) == "better than b: -1.00 [-1.00, -1.00] points"


def test_means_over_benchmarks_weigh_each_alike() -> None:
    first = measured({"a": [10, 30] * 3, "b": [0, 0] * 3}, name="one")
    second = measured({"a": [0, 0, 0, 100] * 2, "b": [0, 0, 0, 0] * 2}, name="two")
    found = paired_difference([first, second], "a", "b")
    assert found.value == pytest.approx((20.0 + 25.0) / 2)
    assert found.images == (6, 8)


def test_under_five_images_there_is_no_interval_and_the_record_says_why() -> None:
    found = paired_difference(measured({"a": [20], "b": [23]}), "a", "b")
    assert found.interval is None
    assert found.within_noise is None
    assert found.short == "-3.00 points"
    assert str(found) == ("at -3.00 points against b, no interval: one has 1 image, an interval needs 5")
    several = [measured({"a": [1, 2] * 3, "b": [3, 5] * 3}, name="two"), measured({"a": [20], "b": [23]})]
    mean = paired_difference(several, "a", "b")
    assert mean.value == pytest.approx((-2.5 - 3.0) / 2)
    assert mean.reason == "one has 1 image, an interval needs 5"


def test_sentences_say_noise_and_worse() -> None:
    one = measured({"a": [1, 3] * 10, "b": [2, 2] * 10, "c": [5, 5] * 10})
    assert str(paired_difference(one, "a", "b")).startswith("within noise of b: +0.00 [-0.")
    assert str(paired_difference(one, "c", "b")) == "worse than b: +3.00 [+3.00, +3.00] points"


def test_a_family_is_corrected_together_and_what_has_no_interval_is_no_test() -> None:
    one = measured({"a": [1, 4, 2, 5, 3, 2], "b": [2, 5, 4, 6, 3, 3], "c": []})
    found = corrected([paired_difference(one, name, "b") for name in ("a", "c", "a")])
    alone = paired_difference(one, "a", "b")
    assert found[0].p == pytest.approx(2 * alone.p)
    assert (found[0].family, found[1].family) == (2, 1)
    assert found[1].word == "no interval"
    assert found[0].interval == alone.interval


def test_failures_and_predictions_that_are_not_finite_have_no_interval() -> None:
    one = measured({"a": [], "b": [2, 3]})
    found = paired_difference(one, "a", "b")
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
    found = paired_difference(broken, "a", "b")
    assert found.value == math.inf
    assert found.reason == "a prediction on one is not finite"
    assert paired_difference(broken, "a", "a").value == 0.0


def test_several_runs_are_averaged_before_they_are_compared() -> None:
    one = measured({"s0": [10, 20], "s1": [20, 40], "b": [10, 20]})
    found = paired_difference(one, ["s0", "s1"], "b")
    assert found.value == pytest.approx(7.5)
    assert found.network == "mean of 2 runs"
    spread = seed_spread(one, ["s0", "s1"])
    assert spread.values == (15.0, 30.0)
    assert str(spread) == "22.50 ± 10.61 over 2 seeds (15.00 to 30.00)"
    assert str(Spread((1.5,))) == "1.50 from one seed"


def test_what_cannot_be_compared_is_refused() -> None:
    one = measured({"a": [1, 2], "b": [1, 2]})
    with pytest.raises(InputError, match="network measured on 'one'"):
        paired_difference(one, "a", "c")
    with pytest.raises(InputError, match="expected at least one and each once"):
        paired_difference([one, one], "a", "b")
    pixels = Measured("two", "all-valid", "pairs", "epe", False, one.images)
    with pytest.raises(InputError, match="expected one unit for a mean"):
        paired_difference([one, pixels], "a", "b")
    assert paired_difference([one, pixels], "a", "b", metric="d1").value == 0.0
    with pytest.raises(InputError, match="expected the same images in one order"):
        Measured(
            "x", "all-valid", "pairs", "epe", False, {"a": (image("p", 1, 0),), "b": (image("q", 1, 0),)}
        )
    with pytest.raises(InputError, match="found no value"):
        Spread(())
