"""What the benchmarks of merging share: a world of random task vectors, the memory's speed, and records."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import torch

from sfkit.checkpoints.checks import Kind, TensorSpec
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.linear import merge_flat
from sfkit.merging.recipe import Recipe

SOURCES = 11
TENSORS = 400
BLOCKS = 12


@dataclass(frozen=True)
class MergeTime:
    """One measurement: milliseconds a recipe, and how many times the limit that is."""

    name: str
    elements: int
    threads: int
    milliseconds: float
    limit_milliseconds: float

    @property
    def ratio(self) -> float:
        """Time over limit; 1 is the speed of memory."""
        return self.milliseconds / self.limit_milliseconds


def best_of(work: Callable[[], object], repeats: int = 5) -> float:
    """The shortest of several runs, in seconds; the first one warms up and does not count."""
    work()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def bandwidth(elements: int) -> tuple[float, float]:
    """Copy and triad bandwidth in bytes a second, on arrays of ``elements`` float32 each."""
    a, b, c = (torch.full((elements,), float(i)) for i in range(3))
    copy = best_of(lambda: a.copy_(b))
    triad = best_of(lambda: torch.add(b, c, alpha=0.5, out=a))
    return 2 * 4 * elements / copy, 3 * 4 * elements / triad


class RandomPool:
    """A layout of 400 tensors in 12 blocks, a base and 11 task vectors of random numbers."""

    def __init__(self, elements: int) -> None:
        sizes = [elements // TENSORS] * TENSORS
        specs = [
            TensorSpec(f"b{i % BLOCKS}.{i:03d}.weight", (size,), Kind.WEIGHT) for i, size in enumerate(sizes)
        ]
        self.partition = BlockPartition.of({f"b{b}": [f"b{b}.*"] for b in range(BLOCKS)})
        self.layout = FlatLayout.of(specs, self.partition)
        generator = torch.Generator().manual_seed(0)
        self.base = torch.randn(self.layout.size, generator=generator)
        self.rows = torch.randn(SOURCES, self.layout.size, generator=generator)
        self.vectors = list(self.rows)
        self.names = tuple(f"s{e}" for e in range(SOURCES))
        self.out = torch.empty(self.layout.size)

    def equal(self, count: int) -> Recipe:
        """Equal weights over the first ``count`` sources."""
        weights = {name: 1 / count if e < count else 0.0 for e, name in enumerate(self.names)}
        return Recipe.weighted(weights, self.partition.names)

    def routed(self, seed: int) -> Recipe:
        """Weights and scales of their own for every block."""
        generator = torch.Generator().manual_seed(seed)
        rows = torch.softmax(torch.randn(BLOCKS, SOURCES, generator=generator), dim=1).tolist()
        scales = (0.25 + 1.5 * torch.rand(BLOCKS, generator=generator)).tolist()
        return Recipe(self.names, self.partition.names, tuple(map(tuple, rows)), tuple(scales))

    def merge(self, recipe: Recipe) -> torch.Tensor:
        """Ours, into the buffer the live network's parameters are views of."""
        merge_flat(recipe, self.layout, self.base, self.vectors, self.out)
        return self.out
