"""Left and right images find each other by name, else by number, never by the order of their names."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny import write_pairs

from sfkit.datasets.benchmark import open_benchmark
from sfkit.datasets.matching import match_pairs
from sfkit.errors import InputError


def folders(root: Path, lefts: list[str], rights: list[str]) -> tuple[Path, Path]:
    for side, names in (("left", lefts), ("right", rights)):
        (root / side).mkdir(parents=True)
        for name in names:
            cv2.imwrite(str(root / side / f"{name}.png"), np.zeros((4, 4, 3), np.uint8))
    return root / "left", root / "right"


def stems(pairs: list[tuple[Path, Path]]) -> list[tuple[str, str]]:
    return [(left.stem, right.stem) for left, right in pairs]


def test_numbers_match_where_order_would_not(tmp_path: Path) -> None:
    """By order left10 used to go with right002."""
    sides = folders(tmp_path, ["left1", "left10", "left2"], ["right001", "right002", "right010"])
    expected = [("left1", "right001"), ("left2", "right002"), ("left10", "right010")]
    assert stems(match_pairs(*sides)) == expected
    found = open_benchmark("unlabelled", tmp_path)
    assert sorted((p.left.stem, p.right.stem) for p in found.pairs) == sorted(expected)  # type: ignore[attr-defined]


def test_a_cameras_number_is_not_compared(tmp_path: Path) -> None:
    sides = folders(tmp_path, ["cam0_7", "cam0_8"], ["cam1_8", "cam1_7"])
    assert stems(match_pairs(*sides)) == [("cam0_7", "cam1_7"), ("cam0_8", "cam1_8")]


@pytest.mark.parametrize(
    ("lefts", "rights", "message"),
    [
        (["l1", "l2"], ["r1", "r3"], r"l2\.png: found no image of number 2"),
        (["l1", "l01"], ["r1", "r2"], r"have one number, expected one image of each"),
        (["a", "b"], ["c", "d"], r"a\.png: has no name in common .* 0 numbers"),
        (["l1", "l2_3"], ["r1", "r2"], r"l2_3\.png: .*2 numbers, expected as many as l1\.png"),
    ],
)
def test_numbers_that_do_not_match_are_refused(
    tmp_path: Path, lefts: list[str], rights: list[str], message: str
) -> None:
    sides = folders(tmp_path, lefts, rights)
    with pytest.raises(InputError, match=message):
        match_pairs(*sides)
    with pytest.raises(InputError, match=message):
        open_benchmark("unlabelled", tmp_path)


def test_one_place_for_both_sides_is_refused(tmp_path: Path) -> None:
    left, _ = folders(tmp_path, ["a1"], ["b1"])
    for one in (left, left / "a1.png"):
        with pytest.raises(InputError, match="are one and the same, expected the left and the right image"):
            match_pairs(one, one)
    table = tmp_path / "t.csv"
    table.write_text("left,right\nleft/a1.png,left/a1.png\n")
    with pytest.raises(InputError, match="one and the same"):
        open_benchmark("unlabelled", table)
    table.write_text("left,right,disparity\nleft/a1.png,left/a1.png,d.pfm\n")
    with pytest.raises(InputError, match="one and the same"):
        open_benchmark("pairs", table)


def test_ground_truth_in_pgm_by_its_coding(tmp_path: Path) -> None:
    root = write_pairs(tmp_path, 1, size=(8, 16))
    (root / "pair0" / "disparity.pfm").unlink()
    cv2.imwrite(str(root / "pair0" / "disparity.pgm"), np.full((8, 16), 24, np.uint8))
    with pytest.raises(InputError, match="scale of an image cannot be guessed"):
        open_benchmark("pairs", root)
    sample = open_benchmark("pairs", root, coding="png8:8").pairs[0].load()
    assert (sample.disparity == 3.0).all()


@pytest.mark.parametrize(
    ("left", "right", "truth"),
    [
        ("teddy_left", "teddy_right", "teddy_disparity_left"),
        ("teddy_left", "teddy_right", "teddy_disp_left"),
        ("left", "right", "disparity_left"),
        ("scene1.row3.col3", "scene1.row3.col4", "truedisp.row3.col3"),
    ],
)
def test_names_of_middleburys_older_sets(tmp_path: Path, left: str, right: str, truth: str) -> None:
    made, root = write_pairs(tmp_path / "made", 1, size=(8, 16)) / "pair0", tmp_path / "pairs" / "one"
    root.mkdir(parents=True)
    for old, new in (
        ("left.png", f"{left}.png"),
        ("right.png", f"{right}.png"),
        ("disparity.pfm", f"{truth}.pfm"),
    ):
        shutil.copy(made / old, root / new)
    (pair,) = open_benchmark("pairs", tmp_path / "pairs").pairs
    assert (pair.left.stem, pair.right.stem, pair.disparity.stem) == (left, right, truth)  # type: ignore[attr-defined]
