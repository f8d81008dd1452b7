from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets import Sample, check_data, open_benchmark
from sfkit.datasets.check_sample import problems, warnings
from sfkit.errors import InputError

Writer = Callable[[Path, NDArray[np.generic]], Path]


@pytest.fixture
def sample(eth3d_root: Path) -> Sample:
    return next(open_benchmark("eth3d", eth3d_root).samples())


def mirrored(sample: Sample) -> Sample:
    return replace(sample, left=sample.right, right=sample.left)


def test_sound_data(eth3d_root: Path) -> None:
    report = check_data("eth3d", eth3d_root)
    assert (report.ok, report.found, report.expected, len(report.missing)) == (True, 2, 27, 25)
    assert (report.problems, report.warnings, report.notes, report.incomplete) == ((), (), (), {})
    assert report.to_text().splitlines()[0] == f"eth3d: found 2 of 27 pairs in {eth3d_root}"
    assert "and 17 more" in report.to_text()
    assert json.loads(json.dumps(report.to_dict()))["ok"] is True


def test_exchanged_images_are_noticed(sample: Sample) -> None:
    assert warnings(sample) == ()
    (warning,) = warnings(mirrored(sample))
    assert "left and right look exchanged" in warning


def test_too_few_pixels_to_tell(sample: Sample) -> None:
    sparse = np.full_like(sample.disparity, np.nan)
    sparse[20, 20:40] = 6
    assert warnings(replace(mirrored(sample), disparity=sparse)) == ()


@pytest.mark.parametrize("exchanged", [False, True])
def test_real_pairs_warn_only_when_exchanged(real_data: Path, exchanged: bool) -> None:
    benchmarks = [
        open_benchmark("eth3d", real_data / "eth3d"),
        open_benchmark("kitti2012", real_data / "kitti2012"),
        open_benchmark("pairs", real_data / "pairs/motorcycle"),
        open_benchmark("pairs", real_data / "pairs/cones", coding="png8:4"),
        open_benchmark("pairs", real_data / "pairs/reindeer", coding="png8:2"),
    ]
    for benchmark in benchmarks:
        for loaded in benchmark.samples():
            found = warnings(mirrored(loaded) if exchanged else loaded)
            assert any("exchanged" in text for text in found) == exchanged, benchmark.name
            assert problems(loaded) == ()


def test_wrong_scale_of_real_ground_truth(real_data: Path) -> None:
    report = check_data("pairs", real_data / "pairs/cones", coding="png8:0.5")
    assert any("points outside the right image; check the scale" in text for text in report.warnings)


def test_problems_of_a_pair(sample: Sample) -> None:
    unknown = replace(sample, disparity=np.full_like(sample.disparity, np.nan))
    assert "no ground truth is finite and positive" in problems(unknown)[0]
    assert "the same image" in problems(replace(sample, right=sample.left))[0]
    assert "right image is one flat colour" in problems(replace(sample, right=np.zeros_like(sample.right)))[0]
    wide = sample.disparity.copy()
    wide[1] = 65
    assert (
        "2.6 % of the disparities exceed the image's width of 64 px"
        in problems(replace(sample, disparity=wide))[0]
    )


def test_mask_that_hides_everything(sample: Sample) -> None:
    hidden = replace(sample, nonoccluded=np.zeros(sample.size, bool))
    assert "every pixel with ground truth occluded" in warnings(hidden)[0]


def test_files_that_cannot_be_read_are_problems(eth3d_root: Path, png: Writer) -> None:
    png(eth3d_root / "two_view_training/forest_1s/im1.png", np.zeros((3, 3), np.uint8))
    (eth3d_root / "two_view_training_gt/terrace_1s/disp0GT.pfm").write_bytes(b"Pf\n")
    report = check_data("eth3d", eth3d_root)
    assert not report.ok
    assert "forest_1s: " in report.problems[0]
    assert "found 3x3 pixels, expected 64x40" in report.problems[0]
    assert "terrace_1s: " in report.problems[1]
    assert "not usable as it is: 2 problems" in report.to_text()


def test_eight_bits_where_sixteen_are_due(tmp_path: Path, png: Writer) -> None:
    for folder in ("image_2", "image_3", "disp_occ_0"):
        png(tmp_path / f"training/{folder}/000000_10.png", np.arange(20, dtype=np.uint8).reshape(4, 5))
    report = check_data("kitti2015", tmp_path)
    assert "found a 8-bit image, expected 16 bits" in report.problems[0]


def test_what_is_missing(eth3d_root: Path) -> None:
    (eth3d_root / "two_view_training/forest_1s/im1.png").unlink()
    (eth3d_root / "two_view_training_gt/terrace_1s/mask0nocc.png").unlink()
    shutil.copytree(eth3d_root / "two_view_training/terrace_1s", eth3d_root / "two_view_training/mine")
    report = check_data("eth3d", eth3d_root)
    assert report.incomplete["forest_1s"] == ("two_view_training/forest_1s/im1.png",)
    assert report.incomplete["mine"] == ("two_view_training_gt/mine/disp0GT.pfm",)
    assert "forest_1s" not in report.missing
    assert report.notes == (
        "no occlusion mask, so not for the protocols igev, openstereo: terrace_1s",
        "not among the data set's own names: mine",
    )
    assert "incomplete: forest_1s lacks two_view_training/forest_1s/im1.png" in report.to_text()


def test_the_same_pair_twice(eth3d_root: Path) -> None:
    for folder in ("two_view_training", "two_view_training_gt"):
        shutil.copytree(eth3d_root / folder / "forest_1s", eth3d_root / folder / "forest_2s")
    (warning,) = check_data("eth3d", eth3d_root).warnings
    assert warning == "forest_2s: has the same left image as forest_1s; the pair counts twice"


def test_nothing_there_is_a_report(tmp_path: Path) -> None:
    report = check_data("middlebury", tmp_path, resolution="Q")
    assert (report.ok, report.found, len(report.missing)) == (False, 0, 15)
    assert "expected files such as trainingQ/Adirondack/im0.png" in report.problems[0]
    assert "found no pair" in check_data("pairs", tmp_path).problems[0]


def test_wrong_arguments_are_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown data set"):
        check_data("eth4d", tmp_path)
    with pytest.raises(InputError, match="found no such folder"):
        check_data("eth3d", tmp_path / "absent")


def test_a_table_with_absent_files_is_a_problem(eth3d_root: Path) -> None:
    row = "two_view_training/{0}/im0.png,two_view_training/{0}/im1.png,two_view_training_gt/{0}/disp0GT.pfm"
    rows = [row.format(name) for name in ("forest_1s", "terrace_1s")]
    (eth3d_root / "pairs.csv").write_text("\n".join(["left,right,disparity", *rows]))
    assert check_data("pairs", eth3d_root / "pairs.csv").ok
    (eth3d_root / "two_view_training/forest_1s/im1.png").unlink()
    report = check_data("pairs", eth3d_root / "pairs.csv")
    assert (report.ok, report.found) == (False, 1)
    assert "forest_1s/im1.png (1 in all), expected every file under" in report.problems[0]
