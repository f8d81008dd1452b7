"""NMRF's and FoundationStereo's objectives add up to their means, whole or in parts."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch
import torch.nn.functional as F

from sfkit.architectures import architecture
from sfkit.architectures.nmrf.training import losses
from sfkit.training.objectives import FoundationStereoObjective
from sfkit.training.recipes import recipe_of


def test_nmrfs_objective_is_its_own_loss_with_smooth_l1() -> None:
    torch.manual_seed(0)
    network = architecture("nmrf-res").build().train()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.eval()
    left, right = torch.rand(2, 3, 64, 96) * 255, torch.rand(2, 3, 64, 96) * 255
    truth = torch.rand(2, 64, 96) * 40
    truth[0, :20], truth[1, 50:] = torch.nan, torch.nan
    objective = recipe_of(network).objective
    with torch.no_grad():
        total = (objective.sums(network, left, right, truth) / objective.counts(truth)).sum()
        whole = losses(network.estimate(left, right), truth, smooth=True).total()
        parts = sum(objective.sums(network, left[i, None], right[i, None], truth[i, None]) for i in (0, 1))
    assert float(total) == pytest.approx(float(whole), rel=1e-5)
    counts = sum(objective.counts(truth[i, None]) for i in (0, 1))
    assert torch.equal(counts, objective.counts(truth))
    assert float((parts / counts).sum()) == pytest.approx(float(whole), rel=1e-4)


def test_nmrfs_groups_keep_a_peak_of_their_own() -> None:
    network = architecture("nmrf-swint").build()
    groups = recipe_of(network).groups(network, 2e-4, 1e-5)
    assert {round(group["lr"], 9) for group in groups} == {2e-4, 2e-5}


def test_foundation_stereos_objective_is_the_papers_sequence() -> None:
    rng = torch.Generator().manual_seed(1)
    maps = [torch.rand(1, 8, 16, generator=rng) * 9 for _ in range(3)]
    initial = torch.rand(1, 1, 2, 4, generator=rng) * 3
    truth = torch.rand(1, 8, 16, generator=rng) * 9
    truth[0, 4] = torch.nan
    stub = SimpleNamespace(
        trace=lambda left, right: SimpleNamespace(initial=initial, disparities=tuple(maps))
    )
    objective = FoundationStereoObjective()
    found = objective.sums(stub, truth, truth, truth) / objective.counts(truth)  # type: ignore[arg-type]
    known = torch.isfinite(truth)
    first = F.smooth_l1_loss(
        initial[0, 0, :1], truth[0, :1, ::4] / 4
    )  # of the quarter's two rows one is unknown
    rest = sum(
        w * F.smooth_l1_loss(m[known], truth[known]) for w, m in zip((0.81, 0.9, 1.0), maps, strict=True)
    )
    assert found.tolist() == pytest.approx([float(first), float(rest)], rel=1e-5)
