from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets import Benchmark, Sample, memory_benchmark, open_benchmark
from sfkit.datasets.pairs import MemoryPair
from sfkit.errors import InputError, SfkitWarning

Writer = Callable[[Path, NDArray[np.generic]], Path]


def sample(name: str, *, masked: bool = False, value: int = 0) -> Sample:
    image = np.full((4, 5, 3), value, np.uint8)
    return Sample(name, image, image, np.ones((4, 5), np.float32), np.ones((4, 5), bool) if masked else None)


def test_open_eth3d(eth3d_root: Path) -> None:
    benchmark = open_benchmark("eth3d", eth3d_root)
    assert benchmark.ids == ("forest_1s", "terrace_1s")
    assert (benchmark.protocol, benchmark.metric, benchmark.expected) == ("openstereo", "bad-1.0", 27)
    assert str(benchmark) == "eth3d: 2 of 27 pairs, bad-1.0 under protocol openstereo"
    assert [s.id for s in benchmark.samples()] == list(benchmark.ids)
    benchmark.ensure_scorable()
    described = benchmark.describe()
    assert (described["pairs"], described["unit"], described["licence"]) == (2, "%", "CC BY-NC-SA 4.0")
    assert pickle.loads(pickle.dumps(benchmark)) == benchmark  # noqa: S301 - our own bytes


def test_subsets_keep_the_order_of_the_whole(eth3d_root: Path) -> None:
    benchmark = open_benchmark("eth3d", eth3d_root)
    assert benchmark.first(1).ids == ("forest_1s",)
    assert benchmark.first(5).ids == benchmark.ids
    assert benchmark.select(["terrace_1s", "forest_1s"]).ids == benchmark.ids
    assert open_benchmark("eth3d", eth3d_root, pairs=1).ids == ("forest_1s",)
    assert open_benchmark("eth3d", eth3d_root, pairs=["terrace_1s"]).coverage == "1 of 27 pairs"
    with pytest.raises(
        InputError, match=r"unknown pair of benchmark 'eth3d' 'forest_2s'.*did you mean 'forest_1s'"
    ):
        benchmark.select(["forest_2s"])
    with pytest.raises(InputError, match="expected at least 1 pair"):
        benchmark.first(0)
    with pytest.raises(InputError, match="found no pair, expected at least one"):
        benchmark.select([])


def test_ground_truth_beside_the_images_is_the_same_benchmark(eth3d_root: Path, tmp_path: Path) -> None:
    one = tmp_path / "one"
    shutil.copytree(eth3d_root / "two_view_training", one / "ETH3D/two_view_training")
    shutil.copytree(eth3d_root / "two_view_training_gt", one / "ETH3D/two_view_training", dirs_exist_ok=True)
    fingerprints = {open_benchmark("eth3d", root).fingerprint() for root in (eth3d_root, one)}
    assert len(fingerprints) == 1


def test_fingerprint_depends_on_pairs_alone(eth3d_root: Path) -> None:
    benchmark = open_benchmark("eth3d", eth3d_root)
    assert benchmark.measured_by(protocol="raft").fingerprint() == benchmark.fingerprint()
    assert benchmark.first(1).fingerprint() != benchmark.fingerprint()
    assert replace(benchmark, pairs=benchmark.pairs[::-1]).fingerprint() != benchmark.fingerprint()


def test_missing_mask_names_file_and_protocols(eth3d_root: Path) -> None:
    (eth3d_root / "two_view_training_gt/terrace_1s/mask0nocc.png").unlink()
    benchmark = open_benchmark("eth3d", eth3d_root)
    benchmark.first(1).ensure_scorable()
    with pytest.raises(
        InputError, match=r"terrace_1s: .*no mask0nocc\.png beside.*without: raft, nmrf, all-valid$"
    ):
        benchmark.ensure_scorable()
    benchmark.measured_by(protocol="raft").ensure_scorable()


def test_incomplete_pairs_are_left_out(eth3d_root: Path) -> None:
    (eth3d_root / "two_view_training/forest_1s/im1.png").unlink()
    with pytest.warns(SfkitWarning, match=r"1 pairs are incomplete .*forest_1s \(no two_view_training"):
        assert open_benchmark("eth3d", eth3d_root).ids == ("terrace_1s",)
    (eth3d_root / "two_view_training_gt/terrace_1s/disp0GT.pfm").unlink()
    with pytest.raises(InputError) as caught:
        open_benchmark("eth3d", eth3d_root)
    assert "found no complete pair, left images only" in str(caught.value)
    assert "two_view_training/forest_1s/im1.png" in str(caught.value)


def kitti(root: Path, png: Writer, left: str, right: str, truth: str) -> None:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    for frame in ("000000_10", "000000_11", "000001_10"):
        png(root / f"training/{left}/{frame}.png", grey)
        png(root / f"training/{right}/{frame}.png", grey + 1)
    for frame in ("000000_10", "000001_10"):
        png(root / f"training/{truth}/{frame}.png", grey.astype(np.uint16) * 256)


def test_kitti_colour_comes_before_grey(tmp_path: Path, png: Writer) -> None:
    kitti(tmp_path, png, "image_0", "image_1", "disp_occ")
    grey = open_benchmark("kitti2012", tmp_path)
    assert grey.ids == ("000000_10", "000001_10")
    assert "colour folders colored_0 and colored_1" in grey.notes[0]
    kitti(tmp_path, png, "colored_0", "colored_1", "disp_occ")
    colour = open_benchmark("kitti2012", tmp_path)
    assert colour.notes == ()
    assert "colored_0" in str(colour.pairs[0].left)
    assert np.isnan(next(colour.samples()).disparity[0, 0])
    assert next(colour.samples()).disparity[5, 7] == 47


def test_kitti_mask_comes_from_disp_noc(tmp_path: Path, png: Writer) -> None:
    kitti(tmp_path, png, "image_2", "image_3", "disp_occ_0")
    visible = np.zeros((6, 8), np.uint16)
    visible[2:4] = 300
    png(tmp_path / "training/disp_noc_0/000000_10.png", visible)
    first, second = open_benchmark("kitti2015", tmp_path).samples()
    assert first.nonoccluded is not None
    np.testing.assert_array_equal(first.nonoccluded, visible > 0)
    assert second.nonoccluded is None


def test_middlebury_resolution_and_protocol(tmp_path: Path, eth3d_root: Path) -> None:
    for resolution in "HQ":
        folder = tmp_path / f"MiddEval3/training{resolution}/Piano"
        shutil.copytree(eth3d_root / "two_view_training/forest_1s", folder)
        shutil.copytree(eth3d_root / "two_view_training_gt/forest_1s", folder, dirs_exist_ok=True)
    assert open_benchmark("middlebury", tmp_path).resolution == "H"
    assert open_benchmark("middlebury", tmp_path, protocol="nmrf").resolution == "Q"
    assert open_benchmark("middlebury", tmp_path, protocol="raft", resolution="Q").coverage == "1 of 15 pairs"
    with pytest.raises(InputError, match="found resolution Q, protocol 'openstereo' expected H"):
        open_benchmark("middlebury", tmp_path, resolution="Q")
    with pytest.raises(
        InputError, match=r"expected files such as trainingF/Adirondack/im0\.png; download MiddEval3"
    ):
        open_benchmark("middlebury", tmp_path, protocol="raft", resolution="F")


@pytest.mark.parametrize(
    ("protocol", "metric"), [("openstereo", "d1"), ("raft", "bad-3.0"), ("nmrf", "bad-3.0")]
)
def test_kitti_metric_follows_the_protocol(tmp_path: Path, png: Writer, protocol: str, metric: str) -> None:
    kitti(tmp_path, png, "image_2", "image_3", "disp_occ_0")
    benchmark = open_benchmark("kitti2015", tmp_path, protocol=protocol)
    assert benchmark.metric == metric
    assert open_benchmark("kitti2015", tmp_path).measured_by(protocol=protocol).metric == metric
    assert benchmark.measured_by(protocol="openstereo").metric == "d1"
    assert benchmark.measured_by(metric="epe").measured_by(protocol="raft").metric == "epe"


def test_links_that_lie_in_the_folder_are_followed(
    eth3d_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("outside")
    image = eth3d_root / "two_view_training/forest_1s/im1.png"
    shutil.move(image, outside / "im1.png")
    image.symlink_to(outside / "im1.png")
    assert len(open_benchmark("eth3d", eth3d_root)) == 2


def test_the_root_itself_may_be_a_link(eth3d_root: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    link = tmp_path_factory.mktemp("links") / "eth3d"
    link.symlink_to(eth3d_root)
    assert len(open_benchmark("eth3d", link)) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"protocol": "openstere"}, "unknown protocol 'openstere'.*did you mean 'openstereo'"),
        ({"metric": "bad"}, "unknown metric 'bad', expected epe, d1, .*or bad-T"),
        ({"resolution": "H"}, "it comes in one only; leave it out"),
        ({"coding": "pfm"}, "its manifest says both"),
    ],
)
def test_options_that_do_not_fit(eth3d_root: Path, options: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_benchmark("eth3d", eth3d_root, **options)


def test_no_such_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent: found no such folder"):
        open_benchmark("eth3d", tmp_path / "absent")


def test_memory_benchmark() -> None:
    benchmark = memory_benchmark(
        "rendered", [sample("b"), MemoryPair("a", sample("a", value=3))], metric="bad1"
    )
    assert benchmark.ids == ("b", "a")
    assert (benchmark.family, benchmark.protocol, benchmark.metric) == ("pairs", "all-valid", "bad-1.0")
    assert str(benchmark) == "rendered: 2 pairs, bad-1.0 under protocol all-valid"
    assert benchmark.fingerprint() == memory_benchmark("x", [sample("b"), sample("a", value=3)]).fingerprint()
    assert benchmark.fingerprint() != memory_benchmark("x", [sample("b"), sample("a", value=4)]).fingerprint()


def test_memory_benchmark_checks_masks_and_ids() -> None:
    with pytest.raises(InputError, match=r"found the ids \['a'\] twice"):
        memory_benchmark("x", [sample("a"), sample("a")])
    with pytest.raises(InputError, match="found no pair"):
        memory_benchmark("x", [])
    memory_benchmark("x", [sample("a", masked=True)], family="eth3d", protocol="openstereo").ensure_scorable()
    with pytest.raises(InputError, match="a: protocol 'openstereo' counts visible pixels only"):
        memory_benchmark("x", [sample("a")], family="eth3d", protocol="openstereo").ensure_scorable()
    with pytest.raises(InputError, match="'raft' has no rule for 'pairs', expected one of: all-valid"):
        memory_benchmark("x", [sample("a")], protocol="raft")


def test_real_eth3d_and_kitti(real_data: Path) -> None:
    eth3d = open_benchmark("eth3d", real_data / "eth3d")
    assert eth3d.coverage == "1 of 27 pairs"
    loaded = next(eth3d.samples())
    assert loaded.size == (490, 941)
    assert loaded.calibration is not None
    assert loaded.calibration.focal == 542.019
    assert 0.4 < np.isfinite(loaded.disparity).mean() < 0.6
    kitti2012 = open_benchmark("kitti2012", real_data / "kitti2012")
    assert kitti2012.coverage == "1 of 194 pairs"
    assert "grey" in kitti2012.notes[0]
    # 16-bit values 0 and 17873 are the file's extremes.
    truth = next(kitti2012.samples()).disparity
    assert truth.shape == (370, 1226)
    assert np.nanmax(truth) == 17873 / 256


def test_benchmark_is_the_record() -> None:
    assert isinstance(memory_benchmark("x", [sample("a")]), Benchmark)
