"""Training sets: real frames decode to known residuals, the others from files in their official coding."""

from __future__ import annotations

import gzip
import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import sfkit
from sfkit.datasets.check_source import check_training_set
from sfkit.datasets.shipped import source_manifest_names
from sfkit.datasets.source_codings import read_source_disparity
from sfkit.datasets.source_manifests import load_source_manifest
from sfkit.datasets.training_sets import find_source_pairs, open_training_set

NAMES = (
    *("crestereo", "dynamicreplica", "fallingthings", "fsd", "instereo2k", "sceneflow", "sintel", "spring"),
    *("stereocarla", "tartanair", "unrealstereo4k", "vkitti2"),
)


def test_twelve_manifests() -> None:
    assert source_manifest_names() == NAMES
    for name in NAMES:
        manifest = load_source_manifest(name)
        assert manifest.licence
        assert manifest.citation
        assert manifest.pairs >= 2000
        assert manifest.held_out or manifest.hold_every


# Mean grey-level difference of the right image sampled at x - s d, for s = 1, -1, 1/2, 2, as recorded when
# the frames were fetched. TartanAir's were taken with its sky.
REAL = [
    ("instereo2k", "InStereo2K", 0, (5.18, 37.93, 24.27, 31.83)),
    ("sceneflow", "SceneFlow", 0, (4.20, 35.93, 19.84, 22.94)),
    ("sceneflow", "SceneFlow", 1, (6.01, 27.91, 20.35, 22.30)),
    ("sceneflow", "SceneFlow", 2, (7.46, 30.92, 21.69, 24.45)),
]


def residual(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity: NDArray[np.float32], scale: float
) -> float:
    width = disparity.shape[1]
    x = np.arange(width) - scale * disparity.astype(np.float64)
    inside = np.isfinite(x) & (x >= 0) & (x <= width - 1)
    rows, columns = np.nonzero(inside)
    low = np.minimum(x[inside].astype(int), width - 2)
    part = (x[inside] - low)[:, None]
    seen = right[rows, low] * (1 - part) + right[rows, low + 1] * part
    return float(np.abs(seen - left[rows, columns]).mean())


@pytest.mark.parametrize(("name", "folder", "number", "expected"), REAL)
def test_real_frames_decode_to_their_residuals(
    real_data: Path, name: str, folder: str, number: int, expected: tuple[float, ...]
) -> None:
    data = open_training_set(name, real_data / "sources" / folder, hold_out=False)
    ordered = sorted(data.pairs, key=lambda pair: ("TRAIN" not in pair.id, pair.id))
    sample = ordered[number].load()
    found = [residual(sample.left, sample.right, sample.disparity, s) for s in (1, -1, 0.5, 2)]
    assert found == pytest.approx(expected, abs=0.03)


def test_a_real_tartanair_frame_decodes_to_its_residual_and_its_sky_is_unknown(real_data: Path) -> None:
    (pair,) = open_training_set("tartanair", real_data / "sources" / "TartanAir").pairs
    sample = pair.load()
    path = next((real_data / "sources" / "TartanAir").rglob("*_left_depth.npy"))
    with_sky = read_source_disparity(path, "depth-npy:80")
    assert residual(sample.left, sample.right, with_sky, 1) == pytest.approx(8.30, abs=0.03)
    assert residual(sample.left, sample.right, with_sky, -1) == pytest.approx(30.57, abs=0.03)
    depth = np.load(path)
    assert np.array_equal(np.isfinite(sample.disparity), depth < 10000)
    assert np.allclose(sample.disparity[depth < 10000], 80 / depth[depth < 10000])


def test_virtual_kittis_camera_0_is_the_left_one(real_data: Path) -> None:
    manifest = load_source_manifest("vkitti2")
    found = find_source_pairs(manifest, real_data / "sources" / "VirtualKITTI2")
    assert not found.train  # there are no depths
    assert found.incomplete["Scene01/15-deg-left/frames/rgb/Camera_0/rgb_00000"] == (
        "Scene01/15-deg-left/frames/depth/Camera_0/depth_00000.png",
    )


@pytest.mark.parametrize("name", ["instereo2k", "sceneflow", "tartanair"])
def test_checks_of_real_frames_doubt_nothing(real_data: Path, name: str) -> None:
    folder = {"instereo2k": "InStereo2K", "sceneflow": "SceneFlow", "tartanair": "TartanAir"}[name]
    report = check_training_set(name, real_data / "sources" / folder)
    assert not report.warnings
    assert all("held-out" in problem for problem in report.problems)  # InStereo2K has its test part alone


# The other sets: files in the official layout and coding, of a random scene whose disparity is 8 px + rows.

HEIGHT = 24


def png(array: NDArray[np.integer]) -> bytes:
    """A PNG by the book, without an image library: 8 or 16 bits, 1, 3 or 4 channels in RGB(A) order."""
    array = array[..., None] if array.ndim == 2 else array
    height, width, channels = array.shape
    bits = 8 * array.dtype.itemsize
    rows = array.astype(f">u{array.dtype.itemsize}").reshape(height, -1)
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    kind = {1: 0, 3: 2, 4: 6}[channels]

    def chunk(tag: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    header = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(raw))
        + chunk(b"IEND", b"")
    )


def put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def views(root: Path, left: str, right: str, width: int) -> None:
    rng = np.random.default_rng(0)
    for name in (left, right):
        image = rng.integers(0, 256, (HEIGHT, width, 3), dtype=np.uint8)
        path = root / name
        if name.endswith(".png"):
            put(path, png(image))
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(path), image)


def numbers(low: int, high: int, width: int) -> NDArray[np.uint16]:
    """Random stored values; the first row 0, the second the largest there is."""
    values = np.random.default_rng(1).integers(low, high, (HEIGHT, width), dtype=np.uint16)
    values[0], values[1] = 0, 65535
    return values


Written = tuple[str, NDArray[np.floating], NDArray[np.bool_]]
"""What a writer made: the training set's id of the pair, its disparity, and where it is known."""


def sintel(root: Path) -> Written:
    disparity = np.random.default_rng(2).integers(64, 64 * 1000, (HEIGHT, 96)) / 64  # up to 1000 px
    red, rest = np.floor(disparity / 4), disparity % 4
    rgb = np.stack([red, np.floor(rest * 64), np.zeros_like(red)], axis=-1).astype(np.uint8)
    views(
        root, "training/final_left/alley_1/frame_0001.png", "training/final_right/alley_1/frame_0001.png", 96
    )
    put(root / "training/disparities/alley_1/frame_0001.png", png(rgb))
    covered, outside = np.zeros((2, HEIGHT, 96), np.uint8)
    covered[3], outside[:, 5] = 255, 255
    put(root / "training/occlusions/alley_1/frame_0001.png", png(covered))
    put(root / "training/outofframe/alley_1/frame_0001.png", png(outside))
    return "training/final_left/alley_1/frame_0001", disparity, (covered == 0) & (outside == 0)


def fallingthings(root: Path) -> Written:
    stored = numbers(3000, 60000, 960)
    at = "fat/mixed/kitchen_0"
    views(root, f"{at}/000000.left.jpg", f"{at}/000000.right.jpg", 960)
    put(root / at / "000000.left.depth.png", png(stored))
    cameras = [
        {"name": side, "intrinsic_settings": {"fx": fx}} for side, fx in (("left", 768.0), ("right", 1.0))
    ]
    put(root / at / "_camera_settings.json", json.dumps({"camera_settings": cameras}).encode())
    known = (stored > 0) & (stored < 65535)
    with np.errstate(divide="ignore"):
        return f"{at}/000000.left", 768.0 * 0.06 / (stored / 1e4), known


def vkitti2(root: Path) -> Written:
    stored = numbers(200, 60000, 1242)
    at = "Scene01/clone/frames"
    views(root, f"{at}/rgb/Camera_0/rgb_00007.jpg", f"{at}/rgb/Camera_1/rgb_00007.jpg", 1242)
    put(root / at / "depth/Camera_0/depth_00007.png", png(stored))
    with np.errstate(divide="ignore"):
        return (
            f"{at}/rgb/Camera_0/rgb_00007",
            725.0087 * 0.532725 / (stored / 100),
            (stored > 0) & (stored < 65535),
        )


def unrealstereo4k(root: Path) -> Written:
    disparity = np.random.default_rng(3).uniform(1, 900, (HEIGHT, 3840)).astype(np.float32)
    disparity[0], disparity[1] = 0, np.inf
    views(root, "00003/Image0/00010.png", "00003/Image1/00010.png", 3840)
    (root / "00003/Disp0").mkdir()
    np.save(root / "00003/Disp0/00010.npy", disparity)
    return "00003/Image0/00010", disparity, np.isfinite(disparity) & (disparity > 0)


def crestereo(root: Path) -> Written:
    stored = numbers(32, 60000, 192)
    views(root, "tree/10/a_left.jpg", "tree/10/a_right.jpg", 192)
    put(root / "tree/10/a_left.disp.png", png(stored))
    return "tree/10/a_left", stored / 32, stored > 0


def spring(root: Path) -> Written:
    h5py = pytest.importorskip("h5py")
    whole = np.random.default_rng(4).uniform(1, 500, (2 * HEIGHT, 2 * 192)).astype(np.float32)
    whole[0], whole[2] = 0, np.nan
    views(
        root, "train/0001/frame_left/frame_left_0001.png", "train/0001/frame_right/frame_right_0001.png", 192
    )
    path = root / "train/0001/disp1_left/disp1_left_0001.dsp5"
    path.parent.mkdir(parents=True)
    with h5py.File(path, "w") as file:
        file.create_dataset("disparity", data=whole, compression="gzip")
    disparity = np.array([[whole[2 * y, 2 * x] for x in range(192)] for y in range(HEIGHT)])
    return "train/0001/frame_left/frame_left_0001", disparity, np.isfinite(disparity) & (disparity > 0)


def dynamicreplica(root: Path) -> Written:
    depth = np.random.default_rng(5).uniform(0.5, 20, (HEIGHT, 192)).astype(np.float16)
    depth[0] = 0
    name = "009850-3_obj"
    left = f"train/{name}_source_left/images/{name}_source_left-0003.png"
    views(root, left, f"train/{name}_source_right/images/{name}_source_right-0003.png", 192)
    bits = np.frombuffer(depth.tobytes(), np.uint16).reshape(depth.shape)
    put(root / f"train/{name}_source_left/depths/{name}_source_left_0003.geometric.png", png(bits))
    entries = [
        {
            "sequence_name": name,
            "camera_name": side,
            "frame_number": 3,
            "image": {"size": [HEIGHT, 192]},
            "viewpoint": {"focal_length": [2.5, 2.5], "T": [x, 0, 0], "intrinsics_format": "ndc_isotropic"},
        }
        for side, x in (("left", 0.1), ("right", 0.163))
    ]
    put(root / "train/frame_annotations_train.jgz", gzip.compress(json.dumps(entries).encode()))
    with np.errstate(divide="ignore"):
        return left.removesuffix(".png"), 2.5 * HEIGHT / 2 * 0.063 / depth.astype(np.float64), depth > 0


def stereocarla(root: Path) -> Written:
    stored = numbers(100, 60000, 1600)
    at = "normal/Town01"
    views(root, f"{at}/left/rgb/17.jpg", f"{at}/baseline_054/rgb/17.jpg", 1600)
    put(root / at / "baseline_054/depth/17.png", png(stored))
    with np.errstate(divide="ignore"):
        return f"{at}/baseline_054/rgb/17", 1385.64 * 0.54 / (stored / 100), (stored > 0) & (stored < 65535)


def fsd(root: Path) -> Written:
    disparity = np.random.default_rng(6).integers(1, 200_000, (HEIGHT, 192)) / 1000
    disparity[0] = 0
    whole = np.rint(disparity * 1000).astype(int)
    digits = np.stack([whole // 255**2, whole // 255 % 255, whole % 255], axis=-1).astype(np.uint8)
    at = "warehouse_2500_1/dataset/data"
    views(root, f"{at}/left/rgb/0004.jpg", f"{at}/right/rgb/0004.jpg", 192)
    put(root / at / "left/disparity/0004.png", png(digits))
    return f"{at}/left/rgb/0004", disparity, disparity > 0


def tartanair(root: Path) -> Written:
    depth = np.random.default_rng(7).uniform(1, 90, (HEIGHT, 640)).astype("<f4")
    depth[0] = 20_000
    at = "office/Data_easy/P000"
    left = f"{at}/image_lcam_front/000009_lcam_front.png"
    views(root, left, f"{at}/image_rcam_front/000009_rcam_front.png", 640)
    blue_first = np.frombuffer(depth.tobytes(), np.uint8).reshape(HEIGHT, 640, 4)
    put(root / at / "depth_lcam_front/000009_lcam_front_depth.png", png(blue_first[..., [2, 1, 0, 3]]))
    return left.removesuffix(".png"), 80 / depth, depth < 10_000


WRITERS: dict[str, Callable[[Path], Written]] = {
    w.__name__: w
    for w in (
        *(
            sintel,
            fallingthings,
            vkitti2,
            unrealstereo4k,
            crestereo,
            spring,
            dynamicreplica,
            stereocarla,
            fsd,
        ),
        tartanair,
    )
}


@pytest.mark.parametrize("name", WRITERS)
def test_the_official_coding_is_decoded(tmp_path: Path, name: str) -> None:
    identity, expected, known = WRITERS[name](tmp_path)
    data = open_training_set(name, tmp_path, hold_out=False)
    assert [pair.id for pair in data.pairs] == [identity]
    found = data.pairs[0].load().disparity
    assert np.array_equal(np.isfinite(found), known)
    assert np.allclose(found[known], expected[known], rtol=1e-6)


def test_whole_sequences_are_held_out(tmp_path: Path) -> None:
    for scene in ("Scene01", "Scene06"):
        for frame in range(3):
            at = tmp_path / scene / "clone/frames"
            for part in (
                f"rgb/Camera_0/rgb_{frame:05d}.jpg",
                f"rgb/Camera_1/rgb_{frame:05d}.jpg",
                f"depth/Camera_0/depth_{frame:05d}.png",
            ):
                put(at / part, b"x")
    data = open_training_set("vkitti2", tmp_path)
    assert {pair.id[:7] for pair in data.pairs} == {"Scene01"}
    assert {pair.id[:7] for pair in data.held_out} == {"Scene06"}
    assert data.coverage == "3 of 21260 pairs"


def test_another_width_than_the_cameras_is_refused(tmp_path: Path) -> None:
    stereocarla(tmp_path)
    views(tmp_path, "normal/Town01/left/rgb/17.jpg", "normal/Town01/baseline_054/rgb/17.jpg", 1920)
    (pair,) = open_training_set("stereocarla", tmp_path, hold_out=False).pairs
    with pytest.raises(sfkit.InputError, match="is 1920 pixels wide, expected 1600"):
        pair.load()


def test_a_root_without_the_data_set_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(sfkit.InputError, match=r"no path like .*rgb/Camera_0.*download the rgb and depth"):
        open_training_set("vkitti2", tmp_path)


def test_withdrawn_pairs_are_left_out(tmp_path: Path) -> None:
    for scene in ("0001", "0002"):
        at = "FlyingThings3D"
        put(tmp_path / at / f"frames_cleanpass/TRAIN/A/{scene}/left/0006.png", b"x")
        put(tmp_path / at / f"frames_cleanpass/TRAIN/A/{scene}/right/0006.png", b"x")
        put(tmp_path / at / f"disparity/TRAIN/A/{scene}/left/0006.pfm", b"x")
    put(tmp_path / "all_unused_files.txt", b"TRAIN/A/0002/left/0006.png\n")
    found = find_source_pairs(load_source_manifest("sceneflow"), tmp_path)
    assert [pair.id.split("/")[4] for pair in found.train] == ["0001"]
    assert found.withdrawn == 1


def test_a_wrong_scale_is_found_in_a_real_frame(real_data: Path, tmp_path: Path) -> None:
    """A set that a reader would take for InStereo2K's, stored at half the divisor."""
    source = real_data / "sources/InStereo2K/test/000040"
    target = tmp_path / "train/part1/000001"
    target.mkdir(parents=True)
    for name in ("left.png", "right.png"):
        (target / name).symlink_to(source / name)
    stored = cv2.imread(str(source / "left_disp.png"), cv2.IMREAD_UNCHANGED)
    put(target / "left_disp.png", png(stored // 2))
    # Links that leave the root are refused, so the images are copied.
    for name in ("left.png", "right.png"):
        (target / name).unlink()
        put(target / name, (source / name).read_bytes())
    report = check_training_set("instereo2k", tmp_path)
    assert any("wrongly scaled: 2 times" in warning for warning in report.warnings)
