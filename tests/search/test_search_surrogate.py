"""What a model of the score sees and learns, by hand and by what must hold for all scores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.merging.recipe import routed
from sfkit.search.surrogate import Bend, learned, routing_features, routing_views

SCORES = st.floats(-100.0, 100.0)
UNITS = st.floats(0.1, 50.0)


def test_a_block_is_seen_by_the_coefficients_of_its_task_vectors() -> None:
    recipe = routed(("a", "b"), ("first", "last"), [(0.25, 0.75), (0.5, 0.5)], (1.0, 1.5))
    first, last = routing_features([recipe], ("b", "c", "a"), ("first", "last"), tied=False)
    assert first.tolist() == [[0.75, 0.0, 0.25]]
    assert last.tolist() == [[0.75, 0.0, 0.75]]


def test_tied_blocks_are_seen_by_weights_and_scales_apart_and_by_coefficients() -> None:
    tied = routed(("a", "b"), ("first", "last"), [(0.25, 0.75)] * 2, (1.0, 1.5))
    untied = routed(("a", "b"), ("first", "last"), [(0.25, 0.75), (0.75, 0.25)], (0.5, 1.0))
    names, blocks = ("b", "c", "a"), ("first", "last")
    seen = routing_features([tied, untied], names, blocks, tied=True)
    weights, differences, first, last = (seen[group] for group in routing_views(2, tied=True)[0])
    assert weights.tolist() == [[0.75, 0.0, 0.25], [0.5, 0.0, 0.5]]
    quarter = 0.25 / math.sqrt(2.0)
    assert differences == pytest.approx(
        np.array([[0.0] * 6, [quarter, 0.0, -quarter, -quarter, 0.0, quarter]])
    )
    assert (first.tolist(), last.tolist()) == ([[1.0], [0.5]], [[1.5], [1.0]])
    coefficients = [seen[group] for group in routing_views(2, tied=True)[1]]
    alone = routing_features([tied, untied], names, blocks, tied=False)
    assert np.array_equal(coefficients, alone)
    assert routing_views(2, tied=False) == ((0, 1),)


def test_the_view_that_explains_the_scores_is_looked_at() -> None:
    rng = np.random.default_rng(1)
    one, other = rng.random((30, 2)), rng.random((30, 2))
    for values, told in ((np.sin(3.0 * one).sum(axis=1), (0,)), (np.sin(3.0 * other).sum(axis=1), (1,))):
        model = learned((one, other), values, views=((0,), (1,)))
        assert model.groups == told
        like = learned((one, other), values, like=model)
        assert like.groups == told
    # Of ways that see the same the first is taken.
    assert learned((one, one), np.sin(one).sum(axis=1), views=((1,), (0,))).groups == (1,)


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
