"""The inline engine: evaluations run here, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sfkit.evaluation.engines.worker import Result, Worker
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


class InlineEngine:
    """One worker in this process.

    Args:
        pool: whose networks are merged.
        benchmark: prepared for the pool's architecture.
        device: ``"cpu"``, ``"cuda:0"``, ...
    """

    name = "inline"

    def __init__(self, pool: Pool, benchmark: PreparedBenchmark, *, device: str = "cpu") -> None:
        self.worker = Worker(pool.merge(pool.base_recipe(), device=device), benchmark)

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        """Evaluate recipes; each result is handed over as soon as it is there, with its number."""
        for number, recipe in enumerate(recipes):
            yield number, self.worker.run(recipe)
