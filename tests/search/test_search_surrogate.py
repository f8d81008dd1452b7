"""What a model of the score sees and learns, by hand and by what must hold for all scores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.merging.recipe import routed
from sfkit.search.surrogate import Bend, block_features, learned

SCORES = st.floats(-100.0, 100.0)
UNITS = st.floats(0.1, 50.0)


def test_a_block_is_seen_by_the_coefficients_of_its_task_vectors() -> None:
    recipe = routed(("a", "b"), ("first", "last"), [(0.25, 0.75), (0.5, 0.5)], (1.0, 1.5))
    first, last = block_features([recipe], ("b", "c", "a"), ("first", "last"))
    assert first.tolist() == [[0.75, 0.0, 0.25]]
    assert last.tolist() == [[0.75, 0.0, 0.75]]


@given(SCORES, SCORES, UNITS)
def test_a_bend_leaves_good_scores_and_can_be_undone(score: float, knee: float, unit: float) -> None:
    bend, values = Bend(knee, unit), np.array([score])
    bent = bend(values)
    assert bent[0] <= score + 1e-9
    if score <= knee:
        assert bent[0] == score
    assert bend.undone(bent)[0] == pytest.approx(score, abs=1e-6)


def test_a_bend_by_hand() -> None:
    # 3 above the knee of 10, in units of 3: 10 + 3 ln 2, where a step counts half.
    bend = Bend(10.0, 3.0)
    bent = bend(np.array([13.0]))
    assert bent[0] == pytest.approx(10.0 + 3.0 * math.log(2.0))
    assert bend.slope(bent)[0] == pytest.approx(2.0)
    assert Bend()(np.array([13.0]))[0] == 13.0


def test_a_model_of_bent_scores_foretells_scores() -> None:
    x = np.linspace(0.0, 1.0, 9)[:, None]
    scores = 10.0 + 40.0 * (x[:, 0] - 0.3) ** 2
    model = learned((x,), scores, knee=11.0)
    mean, sd = model.predict((x,))
    assert model.bend.unit == pytest.approx(11.0 - scores.min())
    assert mean == pytest.approx(scores, abs=0.2)
    told, spread, bound = model.bounds((x,), 0.0)
    assert (told.tolist(), spread.tolist()) == (mean.tolist(), sd.tolist())
    assert bound == pytest.approx(mean, abs=1e-6)


def test_length_scales_can_be_taken_from_a_model_of_fewer_scores() -> None:
    rng = np.random.default_rng(0)
    points = (rng.random((20, 2)), rng.random((20, 1)))
    scores = np.sin(5.0 * points[0][:, 0]) + points[1][:, 0]
    before = learned(tuple(group[:12] for group in points), scores[:12])
    after = learned(points, scores, like=before)
    assert after.process.lengths == before.process.lengths
    assert after.process.noise == before.process.noise
    assert after.predict(points)[0] == pytest.approx(scores, abs=0.1)
