"""Networks whose output is known by hand: one level everywhere, NaN below 0, an error above 50."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.datasets.benchmark import Benchmark, memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.merging import Pool, open_pool

SIZE = (40, 60)
calls: list[float] = []
"""The level of every forward pass so far."""
repaired: set[str] = set()
"""Holds "error" while networks above 50 do not raise."""


@register_architecture("flat", blocks={"level": ["level"], "offset": ["offset"]}, version="1")
class Flat(nn.Module):
    """Disparity = level + offset, in pixels, everywhere."""

    def __init__(self, *, factor: float = 1.0) -> None:
        super().__init__()
        self.factor = factor
        self.level = nn.Parameter(torch.zeros(1))
        self.offset = nn.Parameter(torch.zeros(1))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        level = float((self.level + self.offset).detach()) * self.factor
        calls.append(level)
        if level > 50 and "error" not in repaired:
            raise RuntimeError(f"level {level:g} is too high")
        map_ = torch.full((1, *left.shape[-2:]), level)
        if level < 0:
            map_[0, -1, -1] = torch.nan
        return map_


LEVELS = {"low": 4.0, "high": 12.0, "below": -8.0, "wild": 90.0}
"""Sources by name: the level each has; the base has 5."""


def flat_spec(
    folder: Path, levels: Mapping[str, float] = LEVELS, *, base: float = 5.0, name: str = "flat"
) -> PoolSpec:
    """A pool of flat networks; every network's offset is 0."""
    folder.mkdir(parents=True, exist_ok=True)
    for member, level in {"base": base, **levels}.items():
        state = {"level": torch.tensor([level]), "offset": torch.zeros(1)}
        save_file(state, folder / f"{member}.safetensors")
    members = [Member(n, folder / f"{n}.safetensors") for n in ("base", *levels)]
    return PoolSpec(name, "flat", members[0], tuple(members[1:]))


def flat_pool(folder: Path, levels: Mapping[str, float] = LEVELS) -> Pool:
    return open_pool(flat_spec(folder, levels))


def sample(name: str, truth: float, seed: int = 0) -> Sample:
    """A pair of noise whose left half has this disparity, in pixels; the right half is unknown."""
    rng = np.random.default_rng(seed)
    left, right = rng.integers(0, 256, (2, *SIZE, 3), dtype=np.uint8)
    disparity = np.full(SIZE, np.nan, np.float32)
    disparity[:, : SIZE[1] // 2] = truth
    return Sample(name, left, right, disparity)


def benchmark(
    name: str = "noise", truths: tuple[float, ...] = (5.0, 8.0), *, metric: str = "bad-1.0"
) -> Benchmark:
    samples = [sample(f"pair{n}", truth, n) for n, truth in enumerate(truths)]
    return memory_benchmark(name, samples, metric=metric)
