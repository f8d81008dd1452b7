"""Disparity fields: the right view's coordinates inverted exactly."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sfkit.datasets.synthetic import shapes
from sfkit.datasets.synthetic.surfaces import DisparityField, Surface

slopes = st.floats(-0.6, 0.6)
curves = st.floats(-0.01, 0.01)


@given(
    slope_x=slopes, slope_y=slopes, curve_x=curves, curve_y=curves,
    level=st.floats(0.5, 60.0), u=st.floats(-200.0, 200.0), v=st.floats(-100.0, 100.0),
)  # fmt: skip
def test_left_x_inverts_the_projection(
    slope_x: float, slope_y: float, curve_x: float, curve_y: float, level: float, u: float, v: float
) -> None:
    field = DisparityField((150.0, 90.0), level, slope_x, slope_y, curve_x, curve_y)
    x, y = np.array([150.0 + u]), np.array([90.0 + v])
    assume(slope_x + 2.0 * curve_x * u < 0.95)  # the surface turns its front to the right view there
    found = field.left_x(x - field.at(x, y), y)
    assert found[0] == pytest.approx(x[0], abs=1e-6)


@given(curve_x=curves, level=st.floats(0.5, 60.0), x_right=st.floats(-500.0, 500.0))
def test_what_left_x_finds_projects_back(curve_x: float, level: float, x_right: float) -> None:
    field = DisparityField((0.0, 0.0), level, 0.1, 0.0, curve_x)
    y = np.zeros(1)
    x = field.left_x(np.array([x_right]), y)
    assume(np.isfinite(x[0]))
    assert (x - field.at(x, y))[0] == pytest.approx(x_right, abs=1e-6)


def test_a_plane_by_hand() -> None:
    # d = 10 + 0.5 (x - 4): at x = 8, d = 12, so x_right = -4.
    field = DisparityField((4.0, 0.0), 10.0, 0.5)
    assert field.at(np.array([8.0]), np.zeros(1))[0] == 12.0
    assert field.left_x(np.array([-4.0]), np.zeros(1))[0] == 8.0


def test_a_bulge_has_no_point_beyond_its_rim() -> None:
    # d = 5 + 0.1 x^2 turns away where d' = 1, at x = 5: x_right = 5 - 7.5 = -2.5 is the last one reached.
    field = DisparityField((0.0, 0.0), 5.0, curve_x=0.1)
    reached = field.left_x(np.array([-2.6, -2.4]), np.zeros(2))
    assert np.isfinite(reached[0])
    assert np.isnan(reached[1])


def test_covers_asks_box_reach_and_shape() -> None:
    disc = Surface(
        DisparityField((10.0, 10.0), 5.0),
        shapes.ellipse(4.0, 2.0),
        skin=lambda x, y: np.zeros((len(x), 3)),
        box=(6.0, 14.0, 8.0, 12.0),
        reach=(1.0, 9.0),
    )
    x = np.array([10.0, 13.9, 13.9, 14.1, np.nan])
    y = np.array([10.0, 10.0, 11.0, 10.0, 10.0])
    assert disc.covers(x, y, np.full(5, 5.0)).tolist() == [True, True, False, False, False]
    assert not disc.covers(x, y, np.full(5, 9.5)).any()


def test_fence_by_hand() -> None:
    fence = shapes.fence(half_width=10.0, half_height=5.0, period=5.0, bar=2.0, rails=0)
    x = np.array([-10.0, -8.5, -7.5, -5.0, 9.0, 10.5])
    assert fence(x, np.zeros(6)).tolist() == [True, True, False, True, False, False]
    railed = shapes.fence(10.0, 5.0, 5.0, 2.0, rails=2)
    assert railed(np.array([-7.5, -7.5]), np.array([4.0, 0.0])).tolist() == [True, False]
