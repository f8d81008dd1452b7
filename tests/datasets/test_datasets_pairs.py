from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets.digests import file_digest
from sfkit.datasets.pairs import MaskCoding, MemoryPair, Sample, StereoPair
from sfkit.errors import InputError

Writer = Callable[[Path, NDArray[np.generic]], Path]


@pytest.fixture
def pair(eth3d_root: Path) -> StereoPair:
    images, truth = eth3d_root / "two_view_training/forest_1s", eth3d_root / "two_view_training_gt/forest_1s"
    return StereoPair(
        "forest_1s",
        images / "im0.png",
        images / "im1.png",
        truth / "disp0GT.pfm",
        "pfm",
        truth / "mask0nocc.png",
        calibration=images / "calib.txt",
    )


def test_load(pair: StereoPair) -> None:
    sample = pair.load()
    assert sample.id == "forest_1s"
    assert sample.size == (40, 64)
    np.testing.assert_array_equal(sample.left[:, 6:], sample.right[:, :-6])
    assert np.isnan(sample.disparity[0]).all()
    assert (sample.disparity[1:] == 6).all()
    assert sample.nonoccluded is not None
    assert sample.nonoccluded[1:, 6:].all()
    assert not sample.nonoccluded[:, :6].any()
    assert sample.calibration is not None
    assert sample.calibration.baseline == pytest.approx(0.06)


def test_pair_without_ground_truth_loads_as_unknown(pair: StereoPair) -> None:
    sample = replace(pair, disparity=None, mask=None).load()
    assert np.isnan(sample.disparity).all()
    assert sample.nonoccluded is None


def test_mask_from_a_second_disparity_map(pair: StereoPair, png: Writer, tmp_path: Path) -> None:
    stored = np.full((40, 64), 256, np.uint16)
    stored[:, :6] = 0
    mask = png(tmp_path / "noc.png", stored)
    sample = replace(pair, mask=mask, mask_coding=MaskCoding.DISPARITY_16).load()
    assert sample.nonoccluded is not None
    np.testing.assert_array_equal(sample.nonoccluded, stored > 0)


@pytest.mark.parametrize("role", ["right", "disparity", "mask"])
def test_unequal_sizes_name_both_files(pair: StereoPair, png: Writer, role: str) -> None:
    path = pair.files()[role]
    if role == "disparity":
        path.write_bytes(b"Pf\n64 39\n-1\n" + bytes(4 * 64 * 39))
    else:
        png(path, np.zeros((39, 64), np.uint8))
    with pytest.raises(InputError, match="found 64x39 pixels, expected 64x40 as in") as caught:
        pair.load()
    assert str(path) in str(caught.value)
    assert str(pair.left) in str(caught.value)


def test_deep_mask_is_refused(pair: StereoPair, png: Writer) -> None:
    png(pair.files()["mask"], np.zeros((40, 64), np.uint16))
    with pytest.raises(InputError, match="uint16 pixels, expected an 8-bit mask"):
        pair.load()


def test_fingerprint_knows_content_not_place(pair: StereoPair, eth3d_root: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(eth3d_root / "two_view_training_gt", moved)
    copy = replace(pair, disparity=moved / "forest_1s/disp0GT.pfm")
    assert copy.fingerprint() == pair.fingerprint()
    others = (
        replace(pair, id="other"),
        replace(pair, coding="npy"),
        replace(pair, mask=None),
        replace(pair, left=pair.right, right=pair.left),
        replace(pair, mask_coding=MaskCoding.DISPARITY_16),
    )
    assert len({pair.fingerprint(), *(o.fingerprint() for o in others)}) == 1 + len(others)


def test_fingerprint_follows_a_changed_file(pair: StereoPair) -> None:
    before = pair.fingerprint()
    assert pair.disparity is not None
    content = bytearray(pair.disparity.read_bytes())
    content[-1] ^= 1
    stat = pair.disparity.stat()
    pair.disparity.write_bytes(bytes(content))
    os.utime(pair.disparity, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1))
    assert pair.fingerprint() != before


def test_digest_of_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent: cannot be read"):
        file_digest(tmp_path / "absent")


def test_memory_pair(pair: StereoPair) -> None:
    sample = pair.load()
    memory = MemoryPair("a", sample)
    assert memory.load() is sample
    assert memory.fingerprint() == MemoryPair("a", pair.load()).fingerprint()
    assert memory.fingerprint() == pickle.loads(pickle.dumps(memory)).fingerprint()  # noqa: S301 - our own bytes
    changed = sample.disparity.copy()
    changed[5, 5] += 1
    others = (
        MemoryPair("b", sample),
        MemoryPair("a", replace(sample, disparity=changed)),
        MemoryPair("a", replace(sample, nonoccluded=None)),
        MemoryPair("a", sample, digest="seed 3"),
    )
    assert len({memory.fingerprint(), *(o.fingerprint() for o in others)}) == 1 + len(others)


def test_memory_pair_with_a_digest_trusts_it(pair: StereoPair) -> None:
    sample = pair.load()
    other = replace(sample, left=sample.right)
    assert MemoryPair("a", sample, "seed 3").fingerprint() == MemoryPair("a", other, "seed 3").fingerprint()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"right": np.zeros((4, 6, 3), np.uint8)}, r"right image is uint8 of shape \(4, 6, 3\)"),
        ({"left": np.zeros((4, 5, 3), np.float32)}, "left image is float32"),
        ({"disparity": np.zeros((4, 5), np.float64)}, "disparity is float64"),
        ({"nonoccluded": np.zeros((4, 5), np.uint8)}, "mask is uint8"),
    ],
)
def test_sample_checks_its_arrays(changes: dict[str, NDArray], message: str) -> None:
    image = np.zeros((4, 5, 3), np.uint8)
    sample = Sample("x", image, image, np.ones((4, 5), np.float32))
    with pytest.raises(InputError, match=f"sample 'x': {message}"):
        replace(sample, **changes)
