"""The parts of a training: schedule, order, changes of a pair, objectives."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st
from torch import nn
from training_worlds import tiny_sample

import sfkit
from sfkit.architectures import architecture
from sfkit.training import Augmentation, TrainingSettings
from sfkit.training.augment import augment
from sfkit.training.batches import changes, draw
from sfkit.training.loop import one_cycle
from sfkit.training.recipes import training_recipe


@pytest.mark.parametrize(("steps", "warm_up"), [(40, 0.05), (100, 0.3), (1000, 0.01)])
def test_the_schedule_is_pytorchs_one_cycle_with_a_peak_for_each_group(steps: int, warm_up: float) -> None:
    first, second = (nn.Parameter(torch.zeros(1)) for _ in range(2))
    peaks = [5e-4, 5e-5]
    optimiser = torch.optim.SGD([{"params": [first]}, {"params": [second]}], lr=1.0)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=peaks, total_steps=steps, pct_start=warm_up, cycle_momentum=False
    )
    for step in range(steps):
        for group, peak in zip(optimiser.param_groups, peaks, strict=True):
            assert one_cycle(step, steps, peak, warm_up) == pytest.approx(group["lr"], rel=1e-6, abs=1e-12)
        optimiser.step()
        if step < steps - 1:
            schedule.step()


@given(st.integers(0, 2**31), st.integers(1, 40), st.integers(1, 4))
def test_an_epoch_shows_every_pair_once(seed: int, pairs: int, epochs: int) -> None:
    drawn = [draw(seed, position, pairs) for position in range(pairs * epochs)]
    assert Counter(index for _, index in drawn) == dict.fromkeys(range(pairs), epochs)
    assert [epoch for epoch, _ in drawn] == sorted(epoch for epoch, _ in drawn)


def test_an_example_follows_from_seed_epoch_and_pair_alone() -> None:
    sample, how = tiny_sample(0), Augmentation(crop=(32, 64))
    first, again, other = (augment(sample, how, 16, changes(1, epoch, 5)) for epoch in (0, 0, 1))
    assert np.array_equal(first.left, again.left)
    assert np.array_equal(first.right, again.right)
    assert not np.array_equal(first.left, other.left)


def test_a_crop_keeps_views_and_truth_together() -> None:
    sample = tiny_sample(1)
    how = Augmentation(crop=(40, 70), brightness=0, contrast=0, saturation=0, hue=0, erase=0)
    example = augment(sample, how, 16, np.random.default_rng(0))
    assert example.truth.shape == (32, 64)  # 40 and 70, down to multiples of 16
    places = [
        (y, x)
        for y in range(48 - 32 + 1)
        for x in range(96 - 64 + 1)
        if np.array_equal(sample.left[y : y + 32, x : x + 64], example.left)
    ]
    assert len(places) == 1
    y, x = places[0]
    assert np.array_equal(sample.right[y : y + 32, x : x + 64], example.right)
    assert np.array_equal(sample.disparity[y : y + 32, x : x + 64], example.truth)


def test_a_crop_larger_than_the_image_is_limited_to_it() -> None:
    example = augment(tiny_sample(1), Augmentation(crop=(384, 768)), 16, np.random.default_rng(0))
    assert example.truth.shape == (48, 96)


def test_an_image_below_the_networks_divisor_is_refused() -> None:
    with pytest.raises(sfkit.InputError, match=r"tiny-0: found 96x48 pixels.*expected at least 64"):
        augment(tiny_sample(0), Augmentation.none(), 64, np.random.default_rng(0))


def test_no_augmentation_leaves_a_pair_as_it_is() -> None:
    sample = tiny_sample(2)
    example = augment(sample, Augmentation.none(), 16, np.random.default_rng(0))
    assert np.array_equal(example.left, sample.left)
    assert np.array_equal(example.right, sample.right)


def test_brightness_multiplies_and_both_views_alike() -> None:
    sample = tiny_sample(3)
    how = Augmentation(None, 0.4, 0, 0, 0, asymmetric=0, erase=0)
    example = augment(sample, how, 16, np.random.default_rng(7))
    dark = sample.left < 150  # no clipping there
    factor = np.median(example.left[dark & (sample.left > 60)] / sample.left[dark & (sample.left > 60)])
    assert 0.6 <= factor <= 1.4
    assert np.abs(example.left[dark] - factor * sample.left[dark]).max() < 1.0
    dark = sample.right < 150
    assert np.abs(example.right[dark] - factor * sample.right[dark]).max() < 1.0


def test_erasing_paints_boxes_of_the_right_views_mean_and_leaves_the_left() -> None:
    sample = tiny_sample(4)
    how = Augmentation(None, 0, 0, 0, 0, 0, erase=1.0)
    example = augment(sample, how, 16, np.random.default_rng(1))
    assert np.array_equal(example.left, sample.left)
    changed = (example.right != sample.right).any(axis=2)
    assert changed.any()
    mean = np.rint(sample.right.reshape(-1, 3).mean(axis=0))
    assert (example.right[changed] == mean).all()


def test_anynets_objective_is_its_stage_weighted_smooth_l1() -> None:
    torch.manual_seed(0)
    network = architecture("anynet").build(ranges=[2, 2, 2], spn=True).eval()
    left, right = torch.rand(2, 3, 32, 64), torch.rand(2, 3, 32, 64)
    truth = torch.rand(2, 32, 64) * 8
    truth[0, :9] = torch.nan
    objective = training_recipe(network).objective
    sums, count = objective.sums(network, left, right, truth), objective.counts(truth)
    known = torch.isfinite(truth)
    expected = sum(
        weight * F.smooth_l1_loss(stage[known], truth[known])
        for weight, stage in zip((0.25, 0.5, 1, 1), network.stages(left, right), strict=True)
    )
    assert int(count) == 2 * 32 * 64 - 9 * 64
    assert float((sums / count).detach()) == pytest.approx(float(expected.detach()), rel=1e-5)


def test_a_batch_without_truth_still_reaches_every_parameter() -> None:
    network = architecture("anynet").build(ranges=[2, 2, 2], spn=False)
    truth = torch.full((1, 32, 64), torch.nan)
    sums = training_recipe(network).objective.sums(
        network, torch.rand(1, 3, 32, 64), torch.rand(1, 3, 32, 64), truth
    )
    sums.sum().backward()
    assert float(sums.detach()) == 0.0
    assert all(p.grad is not None and not p.grad.any() for p in network.parameters())


class Plain(nn.Module):
    """A network with one number: the disparity of every pixel."""

    def __init__(self) -> None:
        super().__init__()
        self.value = nn.Parameter(torch.tensor(3.0))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return self.value.expand(left.shape[0], *left.shape[-2:])


class Own(Plain):
    """The same with a loss of its own."""

    def loss(self, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        known = torch.isfinite(truth)
        return ((self(left, right) - truth)[known] ** 2).mean()


def test_any_network_learns_by_smooth_l1_on_its_output_or_by_its_own_loss() -> None:
    image, truth = torch.zeros(1, 3, 4, 4), torch.full((1, 4, 4), 5.0)
    truth[0, 0] = torch.nan
    for network, expected in ((Plain(), 1.5), (Own(), 4.0)):  # |3 - 5| - 0.5, and (3 - 5)^2
        objective = training_recipe(network).objective
        value = objective.sums(network, image, image, truth) / objective.counts(truth)
        assert float(value.detach()) == pytest.approx(expected)


def test_settings_count_steps_as_the_paper_does() -> None:
    assert TrainingSettings().steps(1064) == 1330  # Sintel, ten epochs of batches of eight
    assert TrainingSettings().steps(1_000_000) == 31_250
    assert TrainingSettings().steps(3) == 3


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"epoch": 3}, "unknown key of .* 'epoch'.*did you mean 'epochs'"),
        ({"epochs": 0}, "epochs is 0, expected a whole number of at least 1"),
        ({"augmentation": {"erase": 2}}, "erase is 2, expected a number from 0 to 1"),
        ({"augmentation": {"crop": [16]}}, "crop is .*expected height and width"),
        ({"precision": "half"}, "unknown precision 'half'"),
    ],
)
def test_settings_that_make_no_sense_are_refused(table: dict[str, object], sentence: str) -> None:
    with pytest.raises(sfkit.InputError, match=sentence):
        TrainingSettings.from_dict(table, "factory.toml")
