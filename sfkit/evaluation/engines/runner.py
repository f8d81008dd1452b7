"""The engine of an evaluator: made when it is first needed, used by one call at a time."""

from __future__ import annotations

import threading

from sfkit.evaluation.compute import Compute
from sfkit.evaluation.engines.choice import Engine, make_engine
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool


class Runner:
    """One engine, which evaluators that differ in nothing it knows of may share.

    Attributes:
        busy: held during a call, since an engine's workers hold one recipe each.
    """

    def __init__(self, pool: Pool, benchmark: PreparedBenchmark, compute: Compute) -> None:
        self._pool, self._benchmark, self._compute = pool, benchmark, compute
        self._engine: Engine | None = None
        self.busy = threading.Lock()

    @property
    def engine(self) -> Engine:
        """Runs what the store does not have; its workers start with the first recipe."""
        # Not in the constructor: threads and torch's settings travel to workers as they are at first use.
        if self._engine is None:
            self._benchmark.ensure_unchanged()  # workers read its files again
            self._engine = make_engine(self._pool, self._benchmark, self._compute)
        return self._engine

    def release(self) -> None:
        """Let go of networks and workers; they are made again with the next recipe."""
        if self._engine is not None:
            self._engine.close()
