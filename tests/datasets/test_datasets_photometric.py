from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets import check_data, open_benchmark, read_disparity, read_image, read_pfm
from sfkit.datasets.photometric import READINGS, check_ground_truth
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.errors import InputError

Triple = tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]
SIZE = (60, 160)
SHIFT = 6


def shifted(seed: int = 0) -> Triple:
    """Noise seen from two places: every match is exactly ``SHIFT`` px away."""
    image = np.random.default_rng(seed).integers(0, 256, (SIZE[0], SIZE[1] + SHIFT, 3), dtype=np.uint8)
    return image[:, :-SHIFT], image[:, SHIFT:], np.full(SIZE, SHIFT, np.float32)


def instereo(root: Path) -> Triple:
    folder = root / "sources/InStereo2K/test/000040"
    truth = read_disparity(folder / "left_disp.png", "png16:100")
    return read_image(folder / "left.png"), read_image(folder / "right.png"), truth


def flying(root: Path) -> Triple:
    things = root / "sources/SceneFlow/FlyingThings3D"
    left, right = (
        read_image(things / f"frames_cleanpass/TRAIN/A/9004/{s}/0006.png") for s in ("left", "right")
    )
    return left, right, read_pfm(things / "disparity/TRAIN/A/9004/left/0006.pfm")


def tartan(root: Path) -> Triple:
    folder = root / "sources/TartanAir/oldtown/Easy/P000"
    left, right = (read_image(folder / f"image_{s}/001116_{s}.png") for s in ("left", "right"))
    depth = np.load(folder / "depth_left/001116_left_depth.npy")
    return left, right, (80 / depth).astype(np.float32)


def pair(data: str, **options: str) -> Callable[[Path], Triple]:
    def load(root: Path) -> Triple:
        (sample,) = open_benchmark(data.partition("/")[0], root / data, **options).samples()  # type: ignore[arg-type]
        return sample.left, sample.right, sample.disparity

    return load


REAL: dict[str, Callable[[Path], Triple]] = {
    "eth3d": pair("eth3d", protocol="raft"),
    "kitti2012": pair("kitti2012"),
    "motorcycle": pair("pairs/motorcycle"),
    "cones": pair("pairs/cones", coding="png8:4"),
    "reindeer": pair("pairs/reindeer", coding="png8:2"),
    "instereo": instereo,
    "flying": flying,
    "tartan": tartan,
}


def test_every_bit_agrees_along_the_right_disparity() -> None:
    left, right, truth = shifted()
    found = check_ground_truth(left, right, truth)
    assert (found.residual, found.better, found.doubt) == (0.0, (), None)
    # Bits of unrelated windows agree by chance alone; constant truth is the same turned around.
    for name, (theirs, ours) in found.others.items():
        assert (theirs == 0.0) if name.startswith("the ground truth") else (40 < theirs < 55)
        assert ours == 0.0
    assert found.unexplained is None


@pytest.mark.parametrize("factor", [2, 4, 8, 16, 0.5, 0.25])
def test_a_wrong_scale_is_named(factor: float) -> None:
    left, right, truth = shifted()
    doubt = check_ground_truth(left, right, truth * factor).doubt
    assert doubt is not None
    word = f"1/{factor:g} of" if factor > 1 else f"{1 / factor:g} times"
    assert doubt.startswith(f"the disparities look wrongly scaled: {word} them fit the images better")
    divisor = f"multiplied by {factor:g}" if factor > 1 else f"divided by {1 / factor:g}"
    assert f"whose divisor should be {divisor} (0.0 % of census bits differ" in doubt


def test_sign_order_and_rectification_are_named() -> None:
    left, right, truth = shifted()
    assert "exchanged, or the disparity's sign" in str(check_ground_truth(left, right, -truth).doubt)
    # Constant disparity: the exchanged images and the negative disparity are the same statement.
    assert "left and right look exchanged" in str(check_ground_truth(right, left, truth).doubt)
    lower, higher = np.roll(right, 1, axis=0), np.roll(right, -1, axis=0)
    assert "with the right one shifted up by a row" in str(check_ground_truth(left, lower, truth).doubt)
    assert "with the right one shifted down by a row" in str(check_ground_truth(left, higher, truth).doubt)


def test_sparse_ground_truth_suffices_and_too_little_says_nothing() -> None:
    left, right, truth = shifted()
    sparse = np.full_like(truth, np.nan)
    sparse[::4, ::4] = 2 * truth[::4, ::4]
    assert "1/2 of them" in str(check_ground_truth(left, right, sparse).doubt)
    few = np.full_like(truth, np.nan)
    few[20, 20:40] = 2 * SHIFT
    assert check_ground_truth(left, right, few).doubt is None
    none = check_ground_truth(left, right, np.full_like(truth, np.nan))
    assert (none.pixels, none.doubt, np.isnan(none.residual)) == (0, None, True)


def test_images_without_texture_say_nothing() -> None:
    flat = np.full((*SIZE, 3), 90, np.uint8)
    assert check_ground_truth(flat, flat, np.full(SIZE, 12, np.float32)).doubt is None


def test_sizes_must_be_one() -> None:
    left, right, truth = shifted()
    with pytest.raises(InputError, match=r"found the sizes \(60, 160\), \(60, 160\) and \(60, 150\)"):
        check_ground_truth(left, right, truth[:, :150])


@pytest.mark.parametrize("name", REAL)
def test_real_ground_truth_is_right_and_its_errors_are_found(real_data: Path, name: str) -> None:
    left, right, truth = REAL[name](real_data)
    sound = check_ground_truth(left, right, truth)
    assert (sound.doubt, sound.unexplained) == (None, None)
    rows = [theirs / ours for reading, (theirs, ours) in sound.others.items() if "a row" in reading]
    rest = [theirs / ours for reading, (theirs, ours) in sound.others.items() if "a row" not in reading]
    assert min(rows) > 1.05
    assert min(rest) > 1.0  # 256 times the nearly zero disparities of a sky say little
    for factor in (2, 4, 0.5, 0.25):
        (best, *_) = check_ground_truth(left, right, truth * factor, pixels=4000).better
        assert best.scale == 1 / factor
    assert "sign" in str(check_ground_truth(left, right, -truth, pixels=4000).doubt)
    assert "exchanged" in str(check_ground_truth(right, left, truth, pixels=4000).doubt)
    assert "rectified" in str(check_ground_truth(left, np.roll(right, 1, axis=0), truth, pixels=4000).doubt)


@pytest.mark.parametrize("coding", ["png8:1", "png8:8"])
def test_the_check_reports_a_scale_that_passed_before(real_data: Path, coding: str) -> None:
    report = check_data("pairs", real_data / "pairs/cones", coding=coding)
    assert any("the disparities look wrongly scaled" in text for text in report.warnings)


def test_readings_have_names_of_their_own() -> None:
    assert len({reading.name for reading in READINGS}) == len(READINGS)


def swapped(truth: NDArray[np.float32], divisor: int) -> NDArray[np.float32]:
    """What a reader in the wrong byte order makes of 16-bit values, 0 for unknown."""
    stored = np.frombuffer(np.round(np.nan_to_num(truth) * divisor).astype(">u2").tobytes(), "<u2")
    return np.where(stored > 0, stored / divisor, np.nan).reshape(truth.shape).astype(np.float32)


@pytest.mark.parametrize("name", ["motorcycle", "cones", "instereo"])
def test_truth_in_another_order_is_named_on_real_pairs(real_data: Path, name: str) -> None:
    left, right, truth = REAL[name](real_data)
    for divisor in (256, 100):
        found = check_ground_truth(left, right, swapped(truth, divisor), pixels=4000)
        assert "bytes of the 16-bit ground truth look swapped" in str(found.doubt)
    for axis, word in ((0, "upside down"), (1, "mirrored")):
        found = check_ground_truth(left, right, np.flip(truth, axis), pixels=4000)
        assert f"turned around: {word} it fits" in str(found.doubt)


@pytest.mark.parametrize("name", ["motorcycle", "cones", "noise"])
def test_random_truth_explains_nothing(request: pytest.FixtureRequest, name: str) -> None:
    if name == "noise":
        left, right, truth = shifted()
    else:
        left, right, truth = REAL[name](request.getfixturevalue("real_data"))
    values = np.random.default_rng(0).uniform(1, max(40.0, np.nanmax(truth)), truth.shape)
    random = np.where(np.isfinite(truth), values, np.nan).astype(np.float32)
    found = check_ground_truth(left, right, random)
    assert found.doubt is None
    assert "does not explain the images, as read or otherwise" in str(found.unexplained)


def test_a_base_of_255_read_as_256_is_beyond_what_images_tell(real_data: Path) -> None:
    """What the documentation says cannot be told; FSD's coding has its own decoding test."""
    left, right, truth = REAL["motorcycle"](real_data)
    stored = np.round(np.nan_to_num(truth) * 1000).astype(np.int64)
    red, rest = np.divmod(stored, 255**2)
    green, blue = np.divmod(rest, 255)
    wrong = np.where(np.isfinite(truth), (65536 * red + 256 * green + blue) / 1000, np.nan)
    assert 0.05 < float(np.nanmax(wrong - truth)) < 1.0
    found = check_ground_truth(left, right, wrong.astype(np.float32))
    assert (found.doubt, found.unexplained) == (None, None)


def test_the_check_of_data_tells_of_truth_that_explains_nothing(tmp_path: Path) -> None:
    drawn = synthetic_pair(domains()["plain"], 0, height=192, width=384)
    place = tmp_path / "a"
    place.mkdir()
    for side in ("left", "right"):
        cv2.imwrite(str(place / f"{side}.png"), cv2.cvtColor(getattr(drawn, side), cv2.COLOR_RGB2BGR))
    high = float(np.nanmax(drawn.disparity))
    random = np.random.default_rng(0).uniform(high / 2, 2 * high, drawn.disparity.shape).astype(np.float32)
    np.save(place / "disparity.npy", random)
    # By chance a share of random values may do better, which is told in the place of it.
    told = ("does not explain the images", "fit the images better")
    assert any(words in text for words in told for text in check_data("pairs", tmp_path).warnings)
    np.save(place / "disparity.npy", drawn.disparity)
    said = check_data("pairs", tmp_path).warnings
    assert not any(words in text for words in told for text in said)
