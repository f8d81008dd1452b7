"""Points by hand, by projecting them back into both cameras, and in a file read by another reader."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.images import read_image
from sfkit.datasets.ply import write_ply
from sfkit.errors import InputError
from sfkit.evaluation.point_cloud import PointCloud, depth_of, point_cloud

CAMERAS = Calibration(focal=500.0, baseline=0.2, doffs=-2.0, centre=(3.0, 1.0), focal_y=400.0)


def image(height: int, width: int) -> NDArray[np.uint8]:
    return np.arange(height * width * 3, dtype=np.uint32).reshape(height, width, 3).astype(np.uint8)


def read_ply(path: Path) -> tuple[list[str], list[tuple[float, ...]]]:
    """Header lines, and x, y, z, red, green, blue of each point."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    assert len(body) % 15 == 0
    return header.decode().splitlines(), list(struct.iter_unpack("<fffBBB", body))


def test_points_by_hand(tmp_path: Path) -> None:
    """500 px * 0.2 m / (12 - 2) px are 10 m; a column right and two rows down are 2 and 5 cm."""
    disparity = np.full((4, 6), np.nan, np.float32)
    disparity[3, 4] = 12.0
    disparity[0, 0] = 27.0
    cloud = point_cloud(disparity, image(4, 6), CAMERAS)
    path = cloud.write(tmp_path / "c.ply")
    header, points = read_ply(path)
    assert header[0] == "ply"
    assert "format binary_little_endian 1.0" in header
    assert "element vertex 2" in header
    assert points[0] == pytest.approx((-3 * 4 / 500, -1 * 4 / 400, 4.0, 0, 1, 2))
    assert points[1] == pytest.approx((0.02, 0.05, 10.0, 66, 67, 68))


@settings(max_examples=30, database=None, deadline=None)
@given(
    focal=st.floats(50, 5000),
    baseline=st.floats(0.01, 3),
    doffs=st.floats(-20, 200),
    centre=st.tuples(st.floats(-50, 2000), st.floats(-50, 2000)),
    seed=st.integers(0, 2**32 - 1),
)
def test_both_cameras_see_each_point_where_it_was(
    focal: float, baseline: float, doffs: float, centre: tuple[float, float], seed: int
) -> None:
    """The right camera stands ``baseline`` to the right, its principal point ``doffs`` further right."""
    height, width = 5, 7
    disparity = np.random.default_rng(seed).uniform(21, 200, (height, width)).astype(np.float32)
    cameras = Calibration(focal, baseline, doffs, centre)
    x, y, z = point_cloud(disparity, image(height, width), cameras).points.T.astype(np.float64)
    rows, columns = np.indices((height, width)).reshape(2, -1)
    in_left = focal * x / z + centre[0]
    in_right = focal * (x - baseline) / z + centre[0] + doffs
    assert np.allclose(in_left, columns, atol=1e-2)
    assert np.allclose(focal * y / z + centre[1], rows, atol=1e-2)
    assert np.allclose(in_left - in_right, disparity.ravel(), atol=1e-2)


def test_what_has_no_depth_is_no_point() -> None:
    disparity = np.array([[np.nan, np.inf, -np.inf, 2.0], [1.0, 3.0, 12.0, 102.0]], np.float32)
    assert depth_of(disparity, CAMERAS).tolist() == [[np.inf] * 4, [np.inf, 100.0, 10.0, 1.0]]
    colours = image(2, 4)
    cloud = point_cloud(disparity, colours, CAMERAS)
    assert cloud.points[:, 2].tolist() == [100.0, 10.0, 1.0]
    assert np.array_equal(cloud.colours, colours[1, 1:])
    assert point_cloud(disparity, colours, CAMERAS, farthest=10.0).points[:, 2].tolist() == [10.0, 1.0]
    keep = np.ones((2, 4), bool)
    keep[1, 2] = False
    assert point_cloud(disparity, colours, CAMERAS, keep=keep).points[:, 2].tolist() == [100.0, 1.0]


def test_refusals(tmp_path: Path) -> None:
    disparity = np.ones((2, 3), np.float32)
    with pytest.raises(InputError, match=r"needs the principal point, .* give a calibration file"):
        point_cloud(disparity, image(2, 3), Calibration(500.0, 0.2))
    with pytest.raises(InputError, match=r"image: has the shape \(3, 2, 3\), expected \(2, 3, 3\)"):
        point_cloud(disparity, image(3, 2), CAMERAS)
    sized = Calibration(500.0, 0.2, centre=(1.0, 1.0), size=(6, 4))
    for refused in (lambda: point_cloud(disparity, image(2, 3), sized), lambda: depth_of(disparity, sized)):
        with pytest.raises(InputError, match="is of images of 6x4 pixels, found 3x2"):
            refused()
    colours = np.zeros((2, 3), np.uint8)
    with pytest.raises(InputError, match=r"expected both \(N, 3\)"):
        write_ply(tmp_path / "a.ply", np.zeros((3, 3)), colours)
    with pytest.raises(InputError, match="expected one line of ASCII"):
        write_ply(tmp_path / "a.ply", np.zeros((2, 3)), colours, "two\nlines")


def test_no_point_is_a_file_too(tmp_path: Path) -> None:
    nothing = PointCloud(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
    header, points = read_ply(nothing.write(tmp_path / "none.ply"))
    assert "element vertex 0" in header
    assert points == []


def test_the_real_motorcycle_stands_two_to_five_metres_away(real_data: Path) -> None:
    """Its ground truth runs from 7.19 to 59.91 px: 192.03 px m / (d + 31.086 px) are 5.02 and 2.11 m."""
    folder = real_data / "pairs" / "motorcycle"
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"].astype(np.float32)
    cameras = Calibration(994.978, 0.193001, 31.086, (311.193, 254.877), size=(741, 500))
    cloud = point_cloud(truth, read_image(folder / "motorcycle_left.png"), cameras)
    assert len(cloud.points) == np.isfinite(truth).sum()
    z = cloud.points[:, 2]
    assert (z.min(), z.max()) == pytest.approx((2.11, 5.02), abs=0.01)
    assert np.ptp(cloud.points[:, 0]) == pytest.approx(3.29, abs=0.05), "metres of the garage's back wall"
