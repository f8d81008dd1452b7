from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from sfkit.datasets.calibration import read_calibration
from sfkit.datasets.formats import Coding, read_disparity, read_pfm, write_disparity_png16
from sfkit.datasets.images import read_image
from sfkit.datasets.pfm import write_pfm
from sfkit.errors import InputError

Writer = Callable[[Path, NDArray[np.generic]], Path]
same_folder = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=50
)
maps = hnp.arrays(
    np.float32,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=7),
    elements=st.floats(0.5, 250.0, width=32) | st.sampled_from([np.nan, np.inf, 0.0, -3.0]),
)


def unknown_as_nan(array: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.where(np.isfinite(array) & (array > 0), array, np.nan)


def test_pfm_bytes_by_hand(tmp_path: Path) -> None:
    # Bottom row first: the file's first two floats are the lower row.
    little = b"Pf\n2 2\n-1\n" + struct.pack("<4f", 3.0, 4.0, 1.0, float("inf"))
    big = b"Pf 2 2 1.0\n" + struct.pack(">4f", 3.0, 4.0, 1.0, float("inf"))
    for content in (little, big):
        (tmp_path / "a.pfm").write_bytes(content)
        np.testing.assert_array_equal(read_pfm(tmp_path / "a.pfm"), [[1.0, np.inf], [3.0, 4.0]])
        disparity = read_disparity(tmp_path / "a.pfm", "pfm")
        np.testing.assert_array_equal(disparity, [[1.0, np.nan], [3.0, 4.0]])
        assert disparity.dtype == np.float32


def test_pfm_agrees_with_opencv(tmp_path: Path) -> None:
    disparity = np.random.default_rng(1).uniform(1, 90, (5, 7)).astype(np.float32)
    write_pfm(tmp_path / "ours.pfm", disparity)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "ours.pfm"), cv2.IMREAD_UNCHANGED), disparity)
    assert cv2.imwrite(str(tmp_path / "theirs.pfm"), disparity)
    np.testing.assert_array_equal(read_pfm(tmp_path / "theirs.pfm"), disparity)


@same_folder
@given(maps)
def test_pfm_round_trip(tmp_path: Path, disparity: NDArray[np.float32]) -> None:
    write_pfm(tmp_path / "a.pfm", disparity)
    np.testing.assert_array_equal(read_disparity(tmp_path / "a.pfm", "pfm"), unknown_as_nan(disparity))
    assert not np.isnan(read_pfm(tmp_path / "a.pfm")).any()


@same_folder
@given(maps)
def test_png16_round_trip_within_half_a_step(tmp_path: Path, disparity: NDArray[np.float32]) -> None:
    write_disparity_png16(tmp_path / "a.png", disparity)
    read = read_disparity(tmp_path / "a.png", "png16")
    np.testing.assert_allclose(read, unknown_as_nan(disparity), atol=0.5 / 256)


def test_png16_keeps_known_pixels_known(tmp_path: Path) -> None:
    write_disparity_png16(tmp_path / "a.png", np.array([[1e-4, 255.996, np.nan]]))
    stored = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(stored, [[1, 65535, 0]])


def test_png16_refuses_what_does_not_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"256\.00 px, expected at most 255\.99.*PFM"):
        write_disparity_png16(tmp_path / "a.png", np.array([[256.0]]))
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("coding", "stored", "expected"),
    [
        ("png8:4", np.array([[0, 4, 255]], np.uint8), [[np.nan, 1.0, 63.75]]),
        ("png16", np.array([[0, 256, 65535]], np.uint16), [[np.nan, 1.0, 65535 / 256]]),
        ("png16:100", np.array([[0, 256]], np.uint16), [[np.nan, 2.56]]),
    ],
)
def test_png_codings(
    tmp_path: Path, png: Writer, coding: str, stored: NDArray, expected: list[list[float]]
) -> None:
    read = read_disparity(png(tmp_path / "d.png", stored), coding)
    np.testing.assert_array_equal(read, np.array(expected, np.float32))


def test_numpy_codings(tmp_path: Path) -> None:
    disparity = np.array([[1.5, np.inf], [-1.0, 7.0]])
    np.save(tmp_path / "d.npy", disparity)
    np.savez(tmp_path / "one.npz", disparity)
    np.savez(tmp_path / "two.npz", a=disparity, b=disparity + 1)
    expected = [[1.5, np.nan], [np.nan, 7.0]]
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.npy", "npy"), expected)
    np.testing.assert_array_equal(read_disparity(tmp_path / "one.npz", "npz"), expected)
    np.testing.assert_array_equal(read_disparity(tmp_path / "one.npz", "npz:arr_0"), expected)
    np.testing.assert_array_equal(read_disparity(tmp_path / "two.npz", "npz:b")[1], [np.nan, 8.0])
    with pytest.raises(InputError, match=r"entries \['a', 'b'\], expected one; name it"):
        read_disparity(tmp_path / "two.npz", "npz")
    with pytest.raises(InputError, match=r"unknown entry of .*two\.npz 'c', expected one of: a, b"):
        read_disparity(tmp_path / "two.npz", "npz:c")


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "d.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "d.npz", d=np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"d\.npy: cannot be read .*plain numbers"):
        read_disparity(tmp_path / "d.npy", "npy")
    with pytest.raises(InputError, match="entry 'd' cannot be read"):
        read_disparity(tmp_path / "d.npz", "npz:d")


def test_image_channels_and_order(tmp_path: Path, png: Writer) -> None:
    rgb = np.random.default_rng(2).integers(0, 256, (4, 5, 3), dtype=np.uint8)
    np.testing.assert_array_equal(read_image(png(tmp_path / "rgb.png", rgb)), rgb)
    grey = rgb[:, :, 0].copy()
    np.testing.assert_array_equal(read_image(png(tmp_path / "grey.png", grey)), np.stack([grey] * 3, 2))
    alpha = np.dstack([rgb[:, :, ::-1], np.full((4, 5), 7, np.uint8)])
    assert cv2.imwrite(str(tmp_path / "rgba.png"), alpha)
    np.testing.assert_array_equal(read_image(tmp_path / "rgba.png"), rgb)


def test_sixteen_bit_image_is_refused(tmp_path: Path, png: Writer) -> None:
    path = png(tmp_path / "deep.png", np.zeros((3, 3), np.uint16))
    with pytest.raises(InputError, match=r"deep\.png: found uint16 pixels, expected an 8-bit image"):
        read_image(path)


def test_depth_of_a_disparity_png_is_checked(tmp_path: Path, png: Writer) -> None:
    shallow = png(tmp_path / "shallow.png", np.ones((3, 3), np.uint8))
    with pytest.raises(
        InputError, match=r"shallow\.png: found a 8-bit image, expected 16 bits for .*'png16'"
    ):
        read_disparity(shallow, "png16")
    deep = png(tmp_path / "deep.png", np.ones((3, 3), np.uint16))
    with pytest.raises(InputError, match=r"deep\.png: found a 16-bit image, expected 8 bits"):
        read_disparity(deep, "png8:4")
    colour = png(tmp_path / "colour.png", np.ones((3, 3, 3), np.uint8))
    with pytest.raises(InputError, match=r"colour\.png: found 3 channels, expected a one-channel image"):
        read_disparity(colour, "png8:4")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PF\n1 1\n-1\n" + bytes(12), r"colour PFM \(PF\), expected one channel"),
        (b"Pf\n2 2\n-1\n" + bytes(15), "found 15 bytes of pixels, expected 16 for 2x2"),
        (b"Pf\n2 2\n-1\n" + bytes(17), "found 17 bytes of pixels, expected 16"),
        (b"Pf\n999999999 999999999\n-1\n", "expected 3999999992000000004 for"),
        (b"Pf\n0 2\n-1\n", "expected a PFM with none of them 0"),
        (b"Pf\n1 1\n0\n" + bytes(4), "scale 0"),
        (b"\x89PNG\r\n\x1a\n", "found no PFM header"),
        (b"", "found no PFM header"),
    ],
)
def test_bad_pfm(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "bad.pfm").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_disparity(tmp_path / "bad.pfm", "pfm")
    assert "bad.pfm" in str(caught.value)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kept", [0.5, 0.99])
def test_cut_off_images_are_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    whole = cv2.imencode(suffix, noise)[1].tobytes()
    (tmp_path / f"cut{suffix}").write_bytes(whole[: int(len(whole) * kept)])
    with pytest.raises(InputError, match="ends too early"):
        read_image(tmp_path / f"cut{suffix}")


def test_what_is_no_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "empty.png").write_bytes(b"")
    for name in ("text.png", "empty.png"):
        with pytest.raises(InputError, match="no image that can be decoded"):
            read_image(tmp_path / name)
    with pytest.raises(InputError, match=r"absent\.png: cannot be read \(no such file"):
        read_image(tmp_path / "absent.png")


@pytest.mark.parametrize("name", ["d.npy", "d.npz"])
def test_damaged_numpy_files(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"PK\x03\x04 damaged")
    with pytest.raises(InputError, match=f"{name}: cannot be read"):
        read_disparity(tmp_path / name, Path(name).suffix[1:])


def test_numpy_arrays_of_another_kind(tmp_path: Path) -> None:
    np.save(tmp_path / "three.npy", np.zeros((2, 2, 2)))
    np.save(tmp_path / "text.npy", np.array([["a"]]))
    np.savez(tmp_path / "archive.npz", np.ones((2, 2)))
    with pytest.raises(InputError, match=r"float64 of shape \(2, 2, 2\), expected one \(H, W\)"):
        read_disparity(tmp_path / "three.npy", "npy")
    with pytest.raises(InputError, match="expected one"):
        read_disparity(tmp_path / "text.npy", "npy")
    with pytest.raises(InputError, match="found an archive"):
        read_disparity(tmp_path / "archive.npz", "npy")
    with pytest.raises(InputError, match=r"single array, expected an \.npz archive"):
        read_disparity(tmp_path / "three.npy", "npz")


def test_coding_names() -> None:
    assert Coding.parse("png16") == Coding("png16", 256.0)
    assert Coding.parse(" png8:4 ") == Coding("png8", 4.0)
    assert Coding.parse("npz:disp") == Coding("npz", 1.0, "disp")


@pytest.mark.parametrize(
    ("coding", "message"),
    [
        ("png", "unknown coding 'png', expected one of: npy, npz, pfm, png16, png8; did you mean"),
        ("png8", "positive number after the colon"),
        ("png8:0", "positive number after the colon"),
        ("png16:nan", "positive number after the colon"),
        ("pfm:2", "takes nothing after it"),
    ],
)
def test_bad_codings(coding: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Coding.parse(coding)


def test_write_pfm_refuses_other_shapes(tmp_path: Path) -> None:
    for array in (np.zeros((2, 2, 2)), np.zeros((0, 3))):
        with pytest.raises(InputError, match=r"expected \(H, W\)"):
            write_pfm(tmp_path / "a.pfm", array)
        with pytest.raises(InputError, match=r"expected \(H, W\)"):
            write_disparity_png16(tmp_path / "a.png", array)


def test_calibration(tmp_path: Path) -> None:
    text = "cam0=[542.019 0 541.836; 0 542.019 255.198; 0 0 1]\ndoffs=-1.5\nbaseline=59.5549\n"
    (tmp_path / "calib.txt").write_text(text)
    calibration = read_calibration(tmp_path / "calib.txt")
    assert calibration.focal == 542.019
    assert calibration.baseline == pytest.approx(0.0595549)
    assert calibration.doffs == -1.5
    (tmp_path / "calib.txt").write_text(text.replace("baseline=59.5549", "baseline=?"))
    with pytest.raises(InputError, match=r"calib\.txt: found no number for 'baseline'"):
        read_calibration(tmp_path / "calib.txt")
