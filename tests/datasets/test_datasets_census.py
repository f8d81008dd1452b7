from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sfkit.datasets import Metric
from sfkit.datasets.census import SCALES, CensusScale, CensusTarget
from sfkit.errors import InputError

PLAIN = (CensusScale(0.0),)
Image = NDArray[np.uint8]


def noise(height: int, width: int, seed: int = 0) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def by_hand(left: Image, right: Image, disparity: NDArray[np.float32], scale: CensusScale) -> float:
    """The definition pixel by pixel, in double precision: every pair of neighbours seen from one end."""
    high, wide = scale.window[0] // 2, scale.window[1] // 2
    grey = [image.mean(axis=2).astype(np.float64) for image in (left, right)]
    if scale.sigma:
        for axis in (1, 0):
            reach = {"radius": int(np.ceil(3 * scale.sigma)), "mode": "nearest"}
            grey = [gaussian_filter1d(image, scale.sigma, axis=axis, **reach) for image in grey]
    first, second = (image[:: scale.step, :: scale.step] for image in grey)
    shift = disparity[:: scale.step, :: scale.step] / scale.step
    height, width = first.shape
    warped = np.zeros_like(first)
    inside = np.zeros(first.shape, bool)
    for y, x in itertools.product(range(height), range(width)):
        match = x - float(shift[y, x])
        inside[y, x] = 0 <= match <= width - 1
        warped[y, x] = np.interp(match, np.arange(width), second[y])
    differing, count = 0, 0
    after = [(0, dx) for dx in range(1, wide + 1)]
    after += [(dy, dx) for dy in range(1, high + 1) for dx in range(-wide, wide + 1)]
    edge = max(high, wide)
    for y, x in itertools.product(range(edge, height - edge), range(edge, width - edge)):
        if inside[y, x]:
            for dy, dx in after:
                count += 1
                differing += (first[y + dy, x + dx] > first[y, x]) != (warped[y + dy, x + dx] > warped[y, x])
    return 100 * differing / count


@pytest.mark.parametrize("scale", [CensusScale(0.0), *SCALES, CensusScale(1.2, window=(7, 9))])
def test_it_is_its_definition(scale: CensusScale) -> None:
    left, right = noise(30, 44), noise(30, 44, 1)
    right[:, :-3] = left[:, 3:]
    disparity = np.random.default_rng(2).uniform(0.5, 5.5, left.shape[:2]).astype(np.float32)
    found = CensusTarget(left, right, scales=(scale,)).residual(disparity)
    assert found.score == pytest.approx(by_hand(left, right, disparity, scale), abs=0.05)


@given(shift=st.integers(0, 9), seed=st.integers(0, 99))
def test_the_right_disparity_leaves_nothing_and_another_chance(shift: int, seed: int) -> None:
    image = noise(24, 60, seed)
    left, right = image[:, : 60 - shift], image[:, shift:]
    target = CensusTarget(left, right, scales=PLAIN)
    # Of the first pixels whose match is inside, some neighbours' matches are not.
    assert target.residual(np.full(left.shape[:2], shift, np.float32)).score < 1.0
    assert 30 < target.residual(np.full(left.shape[:2], shift + 3, np.float32)).score < 60


@given(gain=st.floats(0.3, 0.9), offset=st.integers(0, 20))
def test_exposure_plays_no_part(gain: float, offset: int) -> None:
    rows = np.random.default_rng(0).permutation(24 * 40).reshape(24, 40) % 60 * 4
    image = np.repeat(rows[..., None], 3, axis=2).astype(np.uint8)
    darker = (image * gain).round().astype(np.uint8) + np.uint8(offset)
    assert CensusTarget(image, darker, scales=PLAIN).residual(np.zeros((24, 40))).score == 0.0


def test_matches_outside_do_not_count_and_none_at_all_is_chance() -> None:
    image = noise(24, 60)
    target = CensusTarget(image, image)
    outside = np.zeros((24, 60), np.float32)
    outside[:, :30] = 100.0
    assert target.residual(np.zeros((24, 60))).inside == 1.0
    assert target.residual(outside).inside == 0.5  # of the 56 columns with a whole window
    nowhere = target.residual(np.full((24, 60), 1000.0))
    assert (nowhere.score, nowhere.inside) == (50.0, 0.0)


def test_a_map_that_is_not_finite_scores_as_chance() -> None:
    image = noise(24, 60)
    broken = np.zeros((24, 60), np.float32)
    broken[3, 3] = np.nan
    assert CensusTarget(image, image).residual(broken).score == 50.0


def test_the_map_has_the_score_as_its_mean() -> None:
    left, right = noise(24, 60), noise(24, 60, 1)
    target = CensusTarget(left, right, scales=PLAIN)
    disparity = np.full((24, 60), 4.0, np.float32)
    map_ = target.map(disparity)
    assert np.isnan(map_[:, :4]).all()
    assert np.nanmean(map_) == pytest.approx(target.residual(disparity).score, abs=1e-4)
    disparity[10, 20] = np.inf
    assert np.isnan(target.map(disparity)[10, 20])


def test_texture_is_told_from_flat_walls() -> None:
    image = np.full((24, 60, 3), 90, np.uint8)
    image[:, 30:] = noise(24, 30)
    assert 0.4 < CensusTarget(image, image).texture < 0.65


def test_it_runs_where_the_network_does() -> None:
    image = noise(24, 60)
    here = CensusTarget(image, image).residual(torch.full((24, 60), 2.0))
    assert CensusTarget(image, image, device=torch.device("cpu")).residual(np.full((24, 60), 2.0)) == here


def test_what_it_refuses() -> None:
    with pytest.raises(InputError, match="found an image of 60x9 pixels, expected at least 10"):
        CensusTarget(noise(9, 60), noise(9, 60))
    with pytest.raises(InputError, match=r"found a map of shape \(3, 3\), expected \(24, 60\)"):
        CensusTarget(noise(24, 60), noise(24, 60)).residual(np.zeros((3, 3)))


def test_it_is_a_metric_that_needs_no_ground_truth() -> None:
    metric = Metric.parse("census")
    assert (metric.unit, metric.needs_truth, metric.lower_is_better) == ("%", False, True)
    assert metric.axis == "census (% of census bits)"
