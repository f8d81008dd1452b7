"""The auto engine: picks between evaluating here and worker processes, and says what it picked and why.

What it picks follows from the device and the work alone, never from the clock. On the CPU it changes no
number of threads behind the caller's back, since the last bits of a convolution can hang on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch

from sfkit.errors import InputError
from sfkit.evaluation.compute import Compute
from sfkit.evaluation.engines.crew import ParallelEngine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.plan import ensure_processes, ensure_rebuildable, module_of
from sfkit.evaluation.engines.processes import process_engine
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

FEW = 2  # recipes a worker: with fewer in a first call, starting workers takes longer than they save


class AutoEngine:
    """Inline on the CPU, on one GPU and for few recipes; processes on several GPUs or for several workers.

    Args:
        pool: whose networks are merged.
        benchmark: prepared for the pool's architecture.
        compute: device ``"cuda"`` means all GPUs; ``workers`` where the caller knows how many.

    Attributes:
        picked: the engine that runs now.
        why: the last part of a sentence.
    """

    name = "auto"

    def __init__(self, pool: Pool, benchmark: PreparedBenchmark, compute: Compute) -> None:
        self._inline = InlineEngine(pool, benchmark, compute)
        self._pool, self._benchmark, self._compute = pool, benchmark, compute
        self.picked: InlineEngine | ParallelEngine = self._inline
        self._least, self.why = self._rule()

    @property
    def workers(self) -> int:
        """How many evaluate at a time, by the engine that runs now."""
        return self.picked.workers

    def start(self) -> None:
        """Make ready what is picked so far."""
        self.picked.start()

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        """As the engine that it picks for them; once workers have started they stay."""
        if self.picked is self._inline and self._least is not None and len(recipes) >= self._least:
            # First: its network and those of the workers need not fit into memory together.
            self._inline.close()
            self.picked = process_engine(self._pool, self._benchmark, self._compute)
        yield from self.picked.run(recipes)

    def describe(self) -> str:
        """What runs now, and why."""
        return f"{self.name} picked {self.picked.describe()} ({self.why})"

    def close(self) -> None:
        """End what runs; what is picked stays picked."""
        self.picked.close()

    def _rule(self) -> tuple[int | None, str]:
        """From how many recipes in a call workers are started (None for never), and why."""
        device, asked = self._compute.device, self._compute.workers
        # A GPU with a number is one device, "cuda" is all of them.
        gpus = torch.cuda.device_count() if device == "cuda" else 1
        workers = asked or (gpus if device == "cuda" else 1)
        if workers == 1:
            one = "the CPU" if device == "cpu" else "one GPU"
            return None, f"{one} is one device: name workers to run several evaluations at a time on it"
        # What workers cannot do is no error here: one process goes on.
        try:
            ensure_processes()
            module_of(self._pool)
            ensure_rebuildable(self._pool)
        except InputError as error:
            return None, str(error)
        if asked:
            return 1, f"{workers} workers were asked for: they start with the first recipe"
        return FEW * workers, f"{workers} GPUs: their workers start with the first {FEW * workers} recipes"
