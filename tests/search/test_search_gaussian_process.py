"""The Gaussian process, against the textbook's formulas and what must hold for every data set."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sfkit.search.gaussian_process import LENGTHS, NOISES, fit, log_evidence, matern


def data(seed: int, count: int = 14) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    points = (rng.random((count, 3)), rng.random((count, 2)))
    return points, np.sin(3.0 * points[0][:, 0]) + points[1][:, 1] + 0.01 * rng.standard_normal(count)


def kernel(one: np.ndarray, other: np.ndarray) -> float:
    """Matern 5/2 by its formula, for points whose features are divided by their length scales already."""
    r = math.sqrt(5.0) * math.dist(one, other)
    return (1.0 + r + r * r / 3.0) * math.exp(-r)


def scaled(points: tuple[np.ndarray, ...], lengths: tuple[float, ...]) -> np.ndarray:
    return np.hstack([group / length for group, length in zip(points, lengths, strict=True)])


def test_a_kernel_by_hand() -> None:
    # r = sqrt(5) * 1 / 1: (1 + 2.23607 + 5 / 3) * exp(-2.23607) = 0.52399
    assert matern([np.array([[1.0]])], [1.0])[0, 0] == pytest.approx(0.5239941)


def test_predictions_are_those_of_the_formulas() -> None:
    points, values = data(0)
    process = fit(points, values)
    known, new = scaled(points, process.lengths), scaled(data(1, 5)[0], process.lengths)
    gram = np.array([[kernel(a, b) for b in known] for a in known]) + process.noise * np.eye(len(known))
    across = np.array([[kernel(a, b) for b in known] for a in new])
    ones = np.ones(len(values))
    level = ones @ np.linalg.solve(gram, values) / (ones @ np.linalg.solve(gram, ones))
    rest = values - level
    variance = rest @ np.linalg.solve(gram, rest) / len(values)
    mean, sd = process.predict(data(1, 5)[0])
    assert mean == pytest.approx(level + across @ np.linalg.solve(gram, rest), rel=1e-6)
    explained = np.sum(across * np.linalg.solve(gram, across.T).T, axis=1)
    assert sd == pytest.approx(np.sqrt(variance * (1.0 - explained)), rel=1e-4)


def test_no_neighbour_on_the_grid_explains_the_values_better() -> None:
    points, values = data(2)
    process = fit(points, values)

    def evidence(lengths: tuple[float, ...], noise: float) -> float:
        known = scaled(points, lengths)
        gram = np.array([[kernel(a, b) for b in known] for a in known]) + noise * np.eye(len(known))
        ones = np.ones(len(values))
        weight = ones @ np.linalg.solve(gram, ones)
        rest = values - ones @ np.linalg.solve(gram, values) / weight
        fitted = rest @ np.linalg.solve(gram, rest) / len(values)
        return -0.5 * (len(values) * math.log(fitted) + np.linalg.slogdet(gram)[1] + math.log(weight))

    found = evidence(process.lengths, process.noise)
    assert log_evidence(process, values) == pytest.approx(found, abs=1e-6)
    for group, length in enumerate(process.lengths):
        for step in (-1, 1):
            index = LENGTHS.index(length) + step
            if 0 <= index < len(LENGTHS):
                near = (*process.lengths[:group], LENGTHS[index], *process.lengths[group + 1 :])
                assert max(evidence(near, noise) for noise in NOISES) <= found + 1e-6


def test_a_model_that_believes_itself_keeps_its_mean_and_is_surer() -> None:
    points, values = data(3)
    process, new = fit(points, values), data(4, 3)[0]
    mean, sd = process.predict(new)
    believed, after = process.believing(new).predict(new)
    assert believed == pytest.approx(mean, abs=1e-6)
    assert np.all(after < sd)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(-50.0, 50.0), st.floats(0.1, 20.0))
def test_moving_and_stretching_the_values_moves_and_stretches_the_model(
    seed: int, shift: float, stretch: float
) -> None:
    points, values = data(seed)
    plain, other = fit(points, values), fit(points, shift + stretch * values)
    assert other.lengths == plain.lengths
    (mean, sd), (moved, wider) = plain.predict(data(seed + 1, 4)[0]), other.predict(data(seed + 1, 4)[0])
    assert moved == pytest.approx(shift + stretch * mean, rel=1e-5, abs=1e-5)
    assert wider == pytest.approx(stretch * sd, rel=1e-3, abs=1e-6)
