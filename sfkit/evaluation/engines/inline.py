"""The inline engine: evaluations run here, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch

from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.engines.worker import Result, Worker
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


class InlineEngine:
    """One worker in this process; its network is built with the first recipe.

    Args:
        pool: whose networks are merged.
        benchmark: prepared for the pool's architecture.
        compute: the device, and how forward passes compute.
    """

    name = "inline"
    workers = 1

    def __init__(self, pool: Pool, benchmark: PreparedBenchmark, compute: Compute = HERE) -> None:
        self.pool, self.benchmark, self.compute = pool, benchmark, compute
        self._worker: Worker | None = None

    @property
    def worker(self) -> Worker:
        """The one worker."""
        if self._worker is None:
            self._worker = Worker(self.compute.model(self.pool), self.benchmark)
        return self._worker

    def start(self) -> None:
        """Build the network, which the first recipe would do otherwise."""
        _ = self.worker

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        """Evaluate recipes; each result is handed over as soon as it is there, with its number."""
        for number, recipe in enumerate(recipes):
            yield number, self.worker.run(recipe)

    def describe(self) -> str:
        """What it runs on, for people."""
        device, threads = self.compute.device, torch.get_num_threads()
        return f"inline: one evaluation at a time on {device}, {threads} thread{'s' * (threads > 1)}"

    def close(self) -> None:
        """Let go of the network; it is built again with the next recipe."""
        self._worker = None
