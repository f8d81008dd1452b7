"""Better, worse, within noise: by hand, and the same word in every place that says it."""

from __future__ import annotations

import math

import pytest
from measured_records import measured

from sfkit.analysis import compare_networks
from sfkit.analysis.labels import Judgement, judge, points
from sfkit.analysis.paired import Difference
from sfkit.evaluation.separation import column_name, marked


@pytest.mark.parametrize(
    ("interval", "judgement", "words"),
    [
        ((-2.0, -1.0), Judgement.BETTER, "better than"),
        ((1.0, 2.0), Judgement.WORSE, "worse than"),
        ((-1.0, 0.0), Judgement.WITHIN_NOISE, "within noise of"),
        ((0.0, 0.0), Judgement.WITHIN_NOISE, "within noise of"),
    ],
)
def test_an_interval_is_judged(interval: tuple[float, float], judgement: Judgement, words: str) -> None:
    found = Difference("a", "b", ("x",), (9,), "%", sum(interval) / 2, interval)
    assert (found.word, judgement.against) == (judgement, words)
    assert str(found).startswith(f"{words} b: ")
    turned = {Judgement.BETTER: Judgement.WORSE, Judgement.WORSE: Judgement.BETTER}
    assert judge(found.value, found.within_noise, lower_is_better=False) is turned.get(judgement, judgement)
    assert judgement.beyond_noise == (judgement in turned)


def test_without_an_interval_nothing_is_said() -> None:
    word = judge(math.nan, None)
    assert (word, word.beyond_noise) == (Judgement.UNKNOWN, False)


def test_what_guided_is_marked_everywhere_alike() -> None:
    one = measured({"a": [10, 20, 30], "b": [0, 50, 20]}, validation=True)
    column = compare_networks([one], "a").columns[0].label
    assert column == column_name("one", "all-valid", "bad-3.0", "%", guided=True)
    assert column == "one (all-valid) bad-3.0 [%] *"
    assert (marked("x", guided=True), marked("x", guided=False)) == ("x *", "x")
    assert (points("%"), points("%", full=True), points("px")) == ("points", "percentage points", "px")
