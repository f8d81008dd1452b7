"""Calibrations as data sets and demos write them; what contradicts itself is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfkit.datasets.calibration import Calibration, read_calibration
from sfkit.errors import InputError

# Middlebury 2014, Motorcycle at a quarter, and the matrices of KITTI's first drive.
MIDDLEBURY = """cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]
cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]
doffs=31.086
baseline=193.001
width=741
height=500
ndisp=70
"""
ROWS = "7.215377e+02 0.0 6.095593e+02 {} 0.0 7.215377e+02 1.728540e+02 {} 0.0 0.0 1.0 {}"
KITTI = {
    0: ROWS.format("0.0", "0.0", "0.0"),
    1: ROWS.format("-3.875744e+02", "0.0", "0.0"),
    2: ROWS.format("4.485728e+01", "2.163791e-01", "2.745884e-03"),
    3: ROWS.format("-3.395242e+02", "2.199936e+00", "2.729905e-03"),
}
K = "754.668 0.0 489.379 0.0 754.668 265.162 0.0 0.0 1.0\n0.063\n"


def kitti(form: str, cameras: tuple[int, ...] = (0, 1, 2, 3)) -> str:
    rows = [f"{form.format(n)}: {KITTI[n]}" for n in cameras]
    return "\n".join(["calib_time: 09-Jan-2012 13:57:47", *rows, "R0_rect: 1 0 0 0 1 0 0 0 1", ""])


def read(folder: Path, text: str, cameras: tuple[int, int] | None = None) -> Calibration:
    (folder / "calib.txt").write_text(text)
    return read_calibration(folder / "calib.txt", cameras)


@pytest.mark.parametrize(
    "left_out", ["", "doffs=31.086\n", "cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]\n"]
)
def test_middlebury_says_the_offset_once_or_twice(tmp_path: Path, left_out: str) -> None:
    """Doffs is cx1 - cx0, by Middlebury's own description of the file."""
    found = read(tmp_path, MIDDLEBURY.replace(left_out, ""))
    assert (found.focal, found.centre, found.size) == (994.978, (311.193, 254.877), (741, 500))
    assert found.baseline == pytest.approx(0.193001)
    assert found.doffs == pytest.approx(342.279 - 311.193)
    assert found.focal_y is None


def test_real_eth3d(real_data: Path) -> None:
    found = read_calibration(real_data / "eth3d/two_view_training/playground/calib.txt")
    assert (found.focal, found.doffs, found.centre) == (542.019, 0.0, (541.836, 255.198))
    assert found.baseline == pytest.approx(0.0595549)
    found.check_size(490, 941)


@pytest.mark.parametrize("form", ["P{}", "P_rect_0{}"])
def test_kitti(tmp_path: Path, form: str) -> None:
    """By hand: (44.85728 + 339.5242) / 721.5377 and 387.5744 / 721.5377 metres."""
    colour = read(tmp_path, kitti(form))
    assert (colour.focal, colour.doffs, colour.centre) == (721.5377, 0.0, (609.5593, 172.8540))
    assert colour.baseline == pytest.approx(0.5327254)
    grey = pytest.approx(0.5371505)
    assert read(tmp_path, kitti(form), (0, 1)).baseline == grey
    assert read(tmp_path, kitti(form, (0, 1))).baseline == grey
    sized = f"S_rect_02: 1.242000e+03 3.750000e+02\n{kitti(form)}"
    assert read(tmp_path, sized).size == (1242, 375)


def test_k_and_baseline(tmp_path: Path) -> None:
    found = read(tmp_path, K)
    assert found == Calibration(754.668, 0.063, 0.0, (489.379, 265.162))
    by_row = "754.668 0 489.379\n0 700 265.162\n0 0 1\n0.063"
    assert read(tmp_path, by_row).focal_y == 700.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (K.replace("0.063", ""), r"found 9 numbers, expected a Middlebury calib\.txt .* or a K\.txt"),
        (K.replace("0.063", "-0.063"), r"baseline is -0\.063, expected a finite number above 0"),
        (K.replace("0.0 0.0 1.0", "0.0 0.0 2.0"), r"K is \[.*\], expected \[f 0 cx; 0 f cy; 0 0 1\]"),
        (K.replace("489.379", "nan"), "found no number for 'cam0'"),
        (K.replace("489.379", "1e999"), r"cx is inf, expected a finite number"),
        (K.replace("489.379", "4_8"), "found no number for 'cam0'"),
        (MIDDLEBURY.replace("31.086", "124.3"), "doffs is 124.3 and cam1 less cam0 is 31.086"),
        (MIDDLEBURY.replace("cam1=[994", "cam1=[884"), "focal length is 994.978 in cam0 and 884.978 in cam1"),
        (MIDDLEBURY + "baseline=5\n", "has 'baseline' twice"),
        (MIDDLEBURY.replace("; 0 0 1]", "]"), "cam0 holds 6 numbers, expected the nine"),
        (MIDDLEBURY.replace("width=741", "width=741.5"), "width is 741.5, expected a number of pixels"),
        (kitti("P{}", (2,)), "found P2 and no P3, expected both cameras"),
        (kitti("P{}", (2, 3, 3)), "has P3 twice"),
        (kitti("P{}").replace("-3.395242e+02", "?"), "P3 holds 12 words"),
        (kitti("P{}").replace("-3.395242e+02", "3.395242e+02"), "baseline is -0.4083"),
        ("", "found no number for 'cam0'"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"calib\.txt: {message}"):
        read(tmp_path, text)


def test_cameras_are_named_of_kitti_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found no rows P0 to P3"):
        read(tmp_path, MIDDLEBURY, (2, 3))
    with pytest.raises(InputError, match="no P7"):
        read(tmp_path, kitti("P{}"), (2, 7))


def test_images_of_another_size_have_another_calibration(tmp_path: Path) -> None:
    found = read(tmp_path, MIDDLEBURY)
    found.check_size(500, 741)
    with pytest.raises(InputError, match=r"of 741x500 pixels, found 2964x1988; give that of these images"):
        found.check_size(1988, 2964)
    read(tmp_path, K).check_size(1, 1)
