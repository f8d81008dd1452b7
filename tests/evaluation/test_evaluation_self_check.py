from __future__ import annotations

import numpy as np

from sfkit.evaluation.self_check import consistency, self_check

SIZE = (24, 60)


def views(shift: int) -> tuple[np.ndarray, np.ndarray]:
    image = np.random.default_rng(0).integers(0, 256, (SIZE[0], SIZE[1] + shift, 3), dtype=np.uint8)
    return image[:, : SIZE[1]], image[:, shift:]


def test_views_that_agree_and_views_that_do_not() -> None:
    left = np.full(SIZE, 5.0, np.float32)
    agree, inside = consistency(left, np.full(SIZE, 5.0, np.float32))
    assert inside[:, 5:].all()
    assert not inside[:, :5].any()
    assert (agree == inside).all()
    right = left.copy()
    right[:, 20] = 6.5  # the match of column 25
    agree, _ = consistency(left, right)
    assert not agree[:, 25].any()
    assert agree[:, 26].all()
    left[3, 30] = np.nan
    assert not consistency(left, right)[1][3, 30]


def test_a_right_prediction_is_believed_and_a_wrong_one_is_not() -> None:
    left, right = views(5)
    truth, wrong = np.full(SIZE, 5.0, np.float32), np.full(SIZE, 9.0, np.float32)
    good, bad = self_check(left, right, truth, truth), self_check(left, right, wrong, wrong)
    assert good.residual < 5 < 35 < bad.residual
    assert (good.consistent, bad.consistent) == (1.0, 1.0)
    assert good.confidence[8:-8, 16:-8].min() > 0.7
    assert bad.confidence[8:-8, 16:-8].mean() < 0.4
    assert not good.confidence[:, :5].any(), "their matches lie outside"
    apart = self_check(left, right, truth, wrong)
    assert (apart.consistent, float(apart.confidence.max())) == (0.0, 0.0)
