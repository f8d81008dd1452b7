"""Pairs that cannot take part are named: a score of the others is not taken for one of all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny import write_pairs

from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.errors import SfkitWarning


def opened(root: Path, message: str) -> Benchmark:
    with pytest.warns(SfkitWarning, match=message):
        return open_benchmark("pairs", root)


def test_a_pair_without_its_right_image(tmp_path: Path) -> None:
    root = write_pairs(tmp_path, 3, size=(8, 16))
    (root / "pair1" / "right.png").unlink()
    found = opened(
        root, r"1 pairs are incomplete and left out: pair1 \(no pair1: the right file\); 2 are scored"
    )
    assert found.ids == ("pair0", "pair2")


def test_a_hint_that_names_no_file(tmp_path: Path) -> None:
    root = write_pairs(tmp_path, 2, size=(8, 16))
    (root / "pair0" / "pairs.toml").write_text('left = "lefft.png"\n')
    assert len(opened(root, r"no pair was recognised among the images in: pair0")) == 1
    (root / "pair0" / "pairs.toml").write_text('disparity = "gone.pfm"\n')
    assert len(opened(root, r"pair0 \(no pair0: the disparity file\)")) == 1


def test_a_link_in_a_circle(tmp_path: Path) -> None:
    root = write_pairs(tmp_path, 2, size=(8, 16))
    (root / "pair2").symlink_to(root / "pair2")
    assert len(opened(root, "links that lead nowhere, or in a circle: pair2")) == 2
    (root / "pair2").unlink()
    (root / "pair0" / "left.png").unlink()
    (root / "pair0" / "left.png").symlink_to(root / "pair0" / "left.png")
    assert len(opened(root, "among the images in: pair0")) == 1


def test_a_pair_of_a_data_set_without_its_right_image(tmp_path: Path) -> None:
    pairs = write_pairs(tmp_path / "made", 2, size=(8, 16))
    for number in range(2):
        place = tmp_path / "Middlebury" / "trainingQ" / ("Adirondack", "Motorcycle")[number]
        place.mkdir(parents=True)
        for old, new in (("left.png", "im0.png"), ("right.png", "im1.png"), ("disparity.pfm", "disp0GT.pfm")):
            (pairs / f"pair{number}" / old).rename(place / new)
    (tmp_path / "Middlebury" / "trainingQ" / "Motorcycle" / "im1.png").unlink()
    with pytest.warns(SfkitWarning, match=r"'middlebury': 1 pairs are incomplete .*Motorcycle"):
        found = open_benchmark("middlebury", tmp_path / "Middlebury", resolution="Q", protocol="nmrf")
    assert found.ids == ("Adirondack",)


def test_whole_folders_say_nothing(tmp_path: Path) -> None:
    root = write_pairs(tmp_path, 2, size=(8, 16))
    (root / "notes").mkdir()
    (root / "notes" / "read.txt").write_text("nothing to see")
    assert len(open_benchmark("pairs", root)) == 2


KITTI = "P0: 7.2e+02 0 6.1e+02 0 0 7.2e+02 1.7e+02 0 0 0 1 0\nTr: 1 0 0 0\n"
NO_OFFSET = "cam0=[7e2 0 0; 0 7e2 0; 0 0 1]\nbaseline=100\n"


@pytest.mark.parametrize("text", [KITTI, NO_OFFSET, "", "\0"])
def test_a_calibration_that_decides_no_score_keeps_nobody_from_scoring(tmp_path: Path, text: str) -> None:
    """Of KITTI, without ``doffs``, or none at all: cameras give depth, and scores are of disparity."""
    root = write_pairs(tmp_path, 1)
    plain = open_benchmark("pairs", root).pairs[0].load()
    (root / "pair0" / "calib.txt").write_text(text)
    sample = open_benchmark("pairs", root).pairs[0].load()
    assert np.array_equal(sample.disparity, plain.disparity, equal_nan=True)
