"""A training that can be stopped at any moment and ends the same.

Nothing random is carried along: step k's pairs follow from the plan's seed and k, the learning rate from k
alone, so network, optimiser and step count are the whole state.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.random import default_rng
from numpy.typing import NDArray
from torch import nn

from sfkit.architectures import InputConvention, architecture
from sfkit.bank.kept import keep, recall
from sfkit.bank.plan import BANK, STAGE_WEIGHTS, BankPlan, TrainingPlan
from sfkit.datasets.synthetic import Domain, SyntheticPair, synthetic_pair
from sfkit.datasets.synthetic.pairs import SEED
from sfkit.evaluation.table import ProgressCallback
from sfkit.files import writing

State = Mapping[str, torch.Tensor]


@dataclass(frozen=True)
class Trained:
    """What a training ends with: the weights, its cost, and the mean loss of its last 50 steps."""

    weights: State
    steps: int
    seconds: float
    cpu_seconds: float
    final_loss: float


def train(
    domain: Domain,
    plan: TrainingPlan,
    start: State | None,
    state_file: Path,
    progress: ProgressCallback | None = None,
    *,
    of: BankPlan = BANK,
) -> Trained:
    """Train on ``domain`` from ``start``, else from seeded weights; continue ``state_file`` if it exists."""
    network = new_network(plan.seed, of)
    inputs = architecture(of.architecture).inputs(of.options)
    if start is not None:
        network.load_state_dict(dict(start))
    optimiser = torch.optim.Adam(network.parameters(), lr=plan.peak_rate)
    step, seconds, cpu_seconds, losses = 0, 0.0, 0.0, list[float]()
    if state_file.exists():
        saved = torch.load(state_file, weights_only=True)
        network.load_state_dict(saved["network"])
        optimiser.load_state_dict(saved["optimiser"])
        step, seconds, cpu_seconds = saved["step"], saved["seconds"], saved["cpu_seconds"]
        losses = saved["losses"]
    # Where all steps are done no pair is rendered again.
    pairs = training_pairs(domain, plan.scenes, pairs_of(state_file), progress) if step < plan.steps else []
    network.train()
    wall, cpu = time.perf_counter(), time.process_time()
    while step < plan.steps:
        # By the step's number alone: after a stop it goes on with the rates it would have had.
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(plan, step)
        losses.append(_step(network, inputs, optimiser, [pairs[i] for i in batch_of(plan, step)]))
        step += 1
        if step % plan.save_every == 0 or step == plan.steps:
            seconds, wall = seconds + time.perf_counter() - wall, time.perf_counter()
            cpu_seconds, cpu = cpu_seconds + time.process_time() - cpu, time.process_time()
            _save(state_file, network, optimiser, step, seconds, cpu_seconds, losses)
            if progress is not None:
                progress(f"{domain.name}: loss {np.mean(losses[-50:]):.3f}", step, plan.steps)
    weights = {
        # Contiguous: safetensors refuses views and channels-last tensors.
        key: value.detach().clone(memory_format=torch.contiguous_format)
        for key, value in network.state_dict().items()
    }
    return Trained(weights, step, seconds, cpu_seconds, float(np.mean(losses[-50:])))


def new_network(seed: int, of: BankPlan = BANK) -> nn.Module:
    """The network of a bank, its weights drawn from ``seed``; the global random state is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return architecture(of.architecture).build(**of.options)


def pairs_of(state_file: Path) -> Path:
    """The folder where a training keeps its rendered pairs, for when it is stopped and goes on."""
    return state_file.with_suffix(".pairs")


def training_pairs(
    domain: Domain, count: int, folder: Path, progress: ProgressCallback | None = None
) -> list[SyntheticPair]:
    """The first ``count`` training pairs of the domain, kept in ``folder`` as they are rendered."""
    pairs = []
    for index in range(count):
        pairs.append(_pair(domain, index, folder))
        if progress is not None and (index + 1) % 40 == 0:
            progress(f"{domain.name}: rendering", index + 1, count)
    return pairs


def _pair(domain: Domain, index: int, folder: Path) -> SyntheticPair:
    """One pair, as it was kept or rendered; one that is missing, torn or of another world is rendered."""
    # In its name: a pair of another world or seed is never taken for this one.
    made_from = hashlib.sha256(repr((SEED, index, domain)).encode()).hexdigest()[:16]
    path, names = folder / f"{index:04d}-{made_from}.npz", [field.name for field in fields(SyntheticPair)]
    pair = recall(path, lambda held: SyntheticPair(**{name: held[name] for name in names}))
    if pair is None:
        pair = synthetic_pair(domain, index, split="train")
        keep(path, {name: getattr(pair, name) for name in names})
    return pair


def learning_rate(plan: TrainingPlan, step: int) -> float:
    """The rate of step ``step`` (from 0)."""
    if step < plan.warm_up:
        # Not from 0, at which the first step would move nothing.
        return plan.peak_rate * (step + 1) / plan.warm_up
    done = (step - plan.warm_up) / max(plan.steps - plan.warm_up, 1)
    return plan.peak_rate * 0.5 * (1.0 + math.cos(math.pi * done))


def batch_of(plan: TrainingPlan, step: int) -> NDArray[np.intp]:
    """Which pairs step ``step`` sees: the next of its epoch's order, an incomplete batch left out."""
    epoch, within = divmod(step, plan.scenes // plan.batch)
    # By seed and epoch: the same order after a stop.
    order = default_rng([plan.seed, epoch]).permutation(plan.scenes)
    return order[within * plan.batch : (within + 1) * plan.batch]


def stage_loss(stages: list[torch.Tensor], truth: torch.Tensor) -> torch.Tensor:
    """Smooth L1 of every stage's disparity (B, H, W), weighted; pixels whose truth is NaN do not count."""
    # By index, since NaN times a mask of 0 is NaN.
    valid = torch.isfinite(truth)
    target = truth[valid]
    losses = [w * F.smooth_l1_loss(s[valid], target) for w, s in zip(STAGE_WEIGHTS, stages, strict=True)]
    return torch.stack(losses).sum()


def _step(
    network: nn.Module,
    inputs: InputConvention,
    optimiser: torch.optim.Optimizer,
    pairs: list[SyntheticPair],
) -> float:
    prepared = [inputs.prepare(pair.left, pair.right) for pair in pairs]
    left = torch.cat([p.left for p in prepared])
    right = torch.cat([p.right for p in prepared])
    stages = network.stages(left, right)  # type: ignore[operator]  # nn.Module types attributes as tensors
    cropped = [prepared[0].window.crop(stage) for stage in stages]
    loss = stage_loss(cropped, torch.from_numpy(np.stack([pair.disparity for pair in pairs])))
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
    optimiser.step()
    return float(loss.detach())


def _save(
    state_file: Path,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    step: int,
    seconds: float,
    cpu_seconds: float,
    losses: list[float],
) -> None:
    """Write the whole state, or leave the former one as it was."""
    state = {
        "network": network.state_dict(),
        "optimiser": optimiser.state_dict(),
        "step": step,
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "losses": losses,
    }
    with writing(state_file) as fresh:
        torch.save(state, fresh)
