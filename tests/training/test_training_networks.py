"""NMRF's and FoundationStereo's objectives add up to their means, whole or in parts."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
import torch.nn.functional as F
from training_worlds import SETTINGS

from sfkit.architectures import architecture
from sfkit.architectures.nmrf.training import losses
from sfkit.datasets.pairs import MemoryPair, Sample
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.datasets.training_set import TrainingSet
from sfkit.merging.network import load_network
from sfkit.training import Augmentation
from sfkit.training.finetune import finetune, starting_point
from sfkit.training.objectives import FoundationStereoObjective
from sfkit.training.recipes import training_recipe


def test_nmrfs_objective_is_its_own_loss_with_smooth_l1() -> None:
    torch.manual_seed(0)
    network = architecture("nmrf-res").build().train()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.eval()
    left, right = torch.rand(2, 3, 64, 96) * 255, torch.rand(2, 3, 64, 96) * 255
    truth = torch.rand(2, 64, 96) * 40
    truth[0, :20], truth[1, 50:] = torch.nan, torch.nan
    objective = training_recipe(network).objective
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
    groups = training_recipe(network).groups(network, 2e-4, 1e-5)
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


@pytest.mark.slow
def test_two_steps_move_foundation_stereo_and_leave_its_vit(tmp_path: Path) -> None:
    name, options = "foundation-stereo", {"vit_size": "vits", "iterations": 1, "max_disp": 192}
    drawn = synthetic_pair(domains()["plain"], 0, height=64, width=128)
    pair = MemoryPair("a", Sample("a", drawn.left, drawn.right, drawn.disparity, drawn.nonoccluded))
    settings = replace(SETTINGS, epochs=2, batch=1, augmentation=Augmentation.none())
    made = finetune(
        None,
        TrainingSet("one", (pair,)),
        tmp_path / "a.safetensors",
        name=name,
        options=options,
        settings=settings,
    )
    before = starting_point(None, name=name, options=options, seed=settings.seed).network.state_dict()
    after = load_network(made.path, name=name, options=options).network.state_dict()
    moved = {key for key, tensor in after.items() if not torch.equal(tensor, before[key])}
    assert {key for key in moved if key.startswith("feature.dino.")} == set()
    entry = architecture(name)
    used = [key for key in after if not any(fnmatchcase(key, dead) for dead in entry.dead)]
    parts = {key.partition(".")[0] for key in used if not entry.is_frozen(key)}
    assert {key.partition(".")[0] for key in moved} == parts, "every part of the network learns"
    assert all(tensor.isfinite().all() for tensor in after.values())
