"""Numbered pairs: reproducible, independent of order, and as their domain says."""

import random
from dataclasses import replace

import numpy as np
import pytest
import torch

from sfkit.datasets.synthetic import SyntheticPair, domains, synthetic_pair, worlds
from sfkit.datasets.synthetic.domains import VALIDATION


def small(name: str, index: int = 0, split: str = "train") -> SyntheticPair:
    """A pair at a quarter of the size."""
    return synthetic_pair({**domains(), **worlds()}[name], index, split=split, height=96, width=192)


def assert_equal(a: SyntheticPair, b: SyntheticPair) -> None:
    np.testing.assert_array_equal(a.left, b.left)
    np.testing.assert_array_equal(a.right, b.right)
    np.testing.assert_array_equal(a.disparity, b.disparity)
    np.testing.assert_array_equal(a.nonoccluded, b.nonoccluded)


def test_a_number_gives_the_same_pair_whatever_came_before() -> None:
    first = small("courtyard", 3)
    small("haze", 1)
    np.random.default_rng().random(3)
    assert_equal(small("courtyard", 3), first)


def test_global_random_state_is_left_alone() -> None:
    before = random.getstate(), torch.get_rng_state()
    legacy = np.random.get_state()
    small("sensor-noise")
    assert random.getstate() == before[0]
    assert torch.equal(torch.get_rng_state(), before[1])
    np.testing.assert_array_equal(np.random.get_state()[1], legacy[1])


def test_splits_numbers_and_domains_differ() -> None:
    pairs = [small("plain"), small("plain", 1), small("plain", split="held-out"), small("haze")]
    for i, a in enumerate(pairs):
        for b in pairs[:i]:
            assert not np.array_equal(a.left, b.left)


def test_types_and_shapes() -> None:
    pair = small("plain")
    assert pair.left.shape == pair.right.shape == (96, 192, 3)
    assert pair.left.dtype == pair.right.dtype == np.uint8
    assert pair.disparity.dtype == np.float32
    assert pair.disparity.shape == pair.nonoccluded.shape == (96, 192)
    assert pair.nonoccluded.dtype == np.bool_


def test_only_scanned_worlds_have_sparse_truth() -> None:
    for name, world in {**domains(), **worlds()}.items():
        known = np.isfinite(small(name).disparity).mean()
        if world.scanned:
            assert 0.5 * world.scan_density[0] < known < 1.5 * world.scan_density[1]
        else:
            assert known == 1.0


def test_the_scene_does_not_depend_on_the_camera() -> None:
    domain = domains()["sensor-noise"]
    clear = dict.fromkeys(("noise", "blur", "haze"), (0.0, 0.0))
    camera = replace(domain, exposure=0.0, brightness=(1.0, 1.0), grey=0.0, scanned=0.0, **clear)
    ideal = synthetic_pair(camera, 0, height=96, width=192)
    noisy = synthetic_pair(domain, 0, height=96, width=192)
    np.testing.assert_array_equal(ideal.disparity, noisy.disparity)
    assert not np.array_equal(ideal.left, noisy.left)


def test_there_are_eleven_sources_four_benchmarks_and_no_name_twice() -> None:
    assert len(domains()) == 12
    assert len(worlds()) == 4
    assert not set(domains()) & set(worlds())
    assert next(iter(worlds())) == VALIDATION


@pytest.mark.parametrize(
    ("name", "shows"),
    [("grey-pattern", "grey"), ("grey-workshop", "grey"), ("plain", "colour"), ("haze", "colour")],
)
def test_grey_domains_are_grey(name: str, shows: str) -> None:
    left = small(name).left
    assert (left[..., 0] == left[..., 2]).all() == (shows == "grey")
