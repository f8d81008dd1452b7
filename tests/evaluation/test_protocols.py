from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.datasets import open_benchmark
from sfkit.datasets.formats import read_disparity
from sfkit.datasets.metric import Map
from sfkit.datasets.pairs import Sample
from sfkit.datasets.protocols import FAMILIES, RULES, Rule, rule
from sfkit.errors import InputError
from sfkit.evaluation.metrics import ImageErrors, RegionErrors, count_errors
from sfkit.evaluation.regions import regions_of

# Truths on either side of every limit in use; the second half of the row is occluded.
STEPS = (1.0, 191.5, 192.0, 511.5, 512.0, 999.5, 1000.0, 2000.0, np.nan)
TRUTH = np.array([[*STEPS, *STEPS]], np.float32)
VISIBLE = np.array([[True] * 9 + [False] * 9])


def make_sample(*, masked: bool = True) -> Sample:
    image = np.zeros((1, 18, 3), np.uint8)
    return Sample("row", image, image, TRUTH, VISIBLE if masked else None)


def make_errors(
    name: str, pixels: int, bad: int, *, d1: int | None = None, total: float = 0.0
) -> ImageErrors:
    region = RegionErrors(pixels, total, (bad,), bad if d1 is None else d1)
    return ImageErrors(name, (3.0,), 0, {"all": region})


def errors_of(prediction: Map, sample: Sample, own: Rule) -> ImageErrors:
    return count_errors(prediction, regions_of(sample, own.valid_mask(sample), own))


# How many of the eight known steps lie below the limit, visible ones and occluded ones.
@pytest.mark.parametrize(
    ("name", "family", "visible", "occluded"),
    [
        ("openstereo", "eth3d", 2, 0),
        ("openstereo", "middlebury", 2, 0),
        ("openstereo", "kitti", 2, 2),
        ("raft", "eth3d", 4, 4),
        ("raft", "middlebury", 6, 6),
        ("raft", "kitti", 8, 8),
        ("igev", "eth3d", 4, 0),
        ("igev", "middlebury", 2, 0),
        ("igev", "kitti", 2, 2),
        ("nmrf", "eth3d", 4, 4),
        ("nmrf", "middlebury", 6, 6),
        ("nmrf", "kitti", 8, 8),
        *(("all-valid", family, 8, 8) for family in FAMILIES),
    ],
)
def test_valid_pixels(name: str, family: str, visible: int, occluded: int) -> None:
    mask = rule(name, family).valid_mask(make_sample())
    assert mask.dtype == np.bool_
    expected = [
        *([True] * visible + [False] * (9 - visible)),
        *([True] * occluded + [False] * (9 - occluded)),
    ]
    assert mask[0].tolist() == expected


@pytest.mark.parametrize("name", sorted(RULES))
@pytest.mark.parametrize("family", FAMILIES)
def test_every_rule_either_scores_or_says_why_not(name: str, family: str) -> None:
    bare = make_sample(masked=False)
    if family == "pairs" and name != "all-valid":
        with pytest.raises(InputError, match=f"'{name}' has no rule for 'pairs', expected one of: all-valid"):
            rule(name, family).valid_mask(bare)
    elif rule(name, family).visible_only:
        with pytest.raises(
            InputError, match=r"row: .*found no occlusion mask, expected mask0nocc\.png.*: raft, nmrf"
        ):
            rule(name, family).valid_mask(bare)
    else:
        assert rule(name, family).valid_mask(bare).any()


def test_no_valid_pixel_names_the_image() -> None:
    image = np.zeros((1, 2, 3), np.uint8)
    far = Sample("far", image, image, np.array([[300, 400]], np.float32))
    with pytest.raises(InputError, match=r"far: protocol 'openstereo' found no valid pixel, .*\(0, 192\) px"):
        rule("openstereo", "kitti").valid_mask(far)
    assert rule("raft", "kitti").valid_mask(far).all()


def test_unknown_protocol() -> None:
    with pytest.raises(InputError, match=r"unknown protocol 'openstero'.*did you mean 'openstereo'"):
        rule("openstero", "kitti")
    with pytest.raises(InputError, match="unknown family 'kitti2015'"):
        rule("raft", "kitti2015").valid_mask(make_sample())


def test_mean_over_images_and_pooled_differ_by_hand() -> None:
    errors = [make_errors("a", 10, 5, total=10), make_errors("b", 90, 9, total=180)]
    assert rule("nmrf", "kitti").aggregate(errors, "bad-3.0") == (50 + 10) / 2
    assert rule("raft", "kitti").aggregate(errors, "bad-3.0") == 14
    assert rule("igev", "kitti").aggregate(errors, "d1") == 14
    assert rule("openstereo", "kitti").aggregate(errors, "d1") == 30
    # RAFT's ETH3D and Middlebury figures, and every EPE, are means over images.
    assert rule("raft", "eth3d").aggregate(errors, "bad-3.0") == 30
    for name in RULES:
        assert rule(name, "kitti").aggregate(errors, "epe") == 1.5


@given(st.lists(st.integers(0, 20), min_size=1, max_size=6))
def test_pooled_is_the_mean_where_images_have_equal_size(bad: list[int]) -> None:
    errors = [make_errors(str(i), 20, n) for i, n in enumerate(bad)]
    pooled = rule("raft", "kitti").aggregate(errors, "bad-3.0")
    assert pooled == pytest.approx(rule("nmrf", "kitti").aggregate(errors, "bad-3.0"))


@given(
    st.lists(
        st.integers(1, 50).flatmap(lambda n: st.tuples(st.just(n), st.integers(0, n))), min_size=1, max_size=6
    )
)
def test_aggregates_are_bounded_and_pooling_ignores_the_split(counts: list[tuple[int, int]]) -> None:
    errors = [make_errors(str(i), n, b) for i, (n, b) in enumerate(counts)]
    values = [e.value("bad-3.0") for e in errors]
    whole = make_errors("whole", sum(n for n, _ in counts), sum(b for _, b in counts))
    for name in ("raft", "nmrf"):
        score = rule(name, "kitti").aggregate(errors, "bad-3.0")
        assert min(values) - 1e-9 <= score <= max(values) + 1e-9
        assert score == rule(name, "kitti").aggregate(errors[::-1], "bad-3.0")
    assert rule("raft", "kitti").aggregate(errors, "bad-3.0") == whole.value("bad-3.0")


def test_one_broken_image() -> None:
    broken = ImageErrors("b", (3.0,), 7, {"all": RegionErrors(10, math.inf, (10,), 10)})
    errors = [make_errors("a", 10, 0), broken]
    assert rule("all-valid", "pairs").aggregate(errors, "epe") == math.inf
    assert rule("all-valid", "pairs").aggregate(errors, "bad-3.0") == 50


def test_nothing_to_aggregate() -> None:
    with pytest.raises(InputError, match="'raft': found no image to average"):
        rule("raft", "kitti").aggregate([], "epe")
    errors = [make_errors("a", 10, 1), make_errors("empty", 0, 0)]
    for name in ("raft", "openstereo"):
        with pytest.raises(InputError, match="image 'empty': found no valid pixel in region 'all'"):
            rule(name, "kitti").aggregate(errors, "bad-3.0")


def test_regions_skip_images_without_them() -> None:
    empty, full = RegionErrors(0, 0.0, (0,), 0), RegionErrors(4, 8.0, (1,), 1)
    errors = [
        ImageErrors("a", (3.0,), 0, {"all": full, "occluded": empty}),
        ImageErrors("b", (3.0,), 0, {"all": full, "occluded": full}),
    ]
    assert rule("raft", "eth3d").aggregate(errors, "epe", region="occluded") == 2
    with pytest.raises(InputError, match="no valid pixel in region 'occluded' of any image"):
        rule("raft", "eth3d").aggregate(errors[:1], "epe", region="occluded")


def test_occluded_pixels_are_recorded_although_they_do_not_count() -> None:
    prediction = np.nan_to_num(TRUTH) + np.where(VISIBLE, 0, 10).astype(np.float32)
    errors = errors_of(prediction, make_sample(), rule("openstereo", "eth3d"))
    assert (errors.pixels, errors.value("epe")) == (2, 0)
    assert (errors.regions["visible"].pixels, errors.regions["occluded"].pixels) == (2, 2)
    assert errors.value("epe", "occluded") == 10


def test_kitti_development_kit_under_each_protocol(real_data: Path) -> None:
    truth = read_disparity(real_data / "kitti2015_devkit/disp_gt.png", "png16")
    estimate = np.nan_to_num(read_disparity(real_data / "kitti2015_devkit/disp_est.png", "png16"))
    image = np.zeros((*truth.shape, 3), np.uint8)
    sample = Sample("kit", image, image, truth)
    for name, metric, expected in (("openstereo", "d1", 13.623), ("raft", "bad-3.0", 14.945)):
        errors = errors_of(estimate, sample, rule(name, "kitti"))
        assert rule(name, "kitti").aggregate([errors], metric) == pytest.approx(expected, abs=5e-4)


def test_real_eth3d_pair_needs_its_mask(real_data: Path) -> None:
    benchmark = open_benchmark("eth3d", real_data / "eth3d")
    loaded = next(benchmark.samples())
    with pytest.raises(InputError, match=r"playground: .*mask0nocc\.png beside the ground truth"):
        rule(benchmark.protocol, benchmark.family).valid_mask(loaded)
    mask = rule("raft", benchmark.family).valid_mask(loaded)
    assert mask.sum() == np.isfinite(loaded.disparity).sum()
