"""Engines by name, and the one that an evaluator uses."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.engines.auto import AutoEngine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.plan import ensure_processes, ensure_rebuildable, module_of
from sfkit.evaluation.engines.processes import process_engine
from sfkit.evaluation.engines.ray_actors import ray_engine
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


class Engine(Protocol):
    """Where evaluations run. All engines give the same results; only their order differs."""

    @property
    def name(self) -> str:
        """What users call it."""
        ...

    @property
    def workers(self) -> int:
        """How many evaluate at a time."""
        ...

    def start(self) -> None:
        """Make networks and workers ready, which the first recipe would do otherwise."""
        ...

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        """Evaluate recipes; each result is handed over as soon as it is there, with its number."""
        ...

    def describe(self) -> str:
        """What it runs on, for people."""
        ...

    def close(self) -> None:
        """Let go of networks and workers; they come back with the next recipe."""
        ...


_MAKERS: dict[str, Callable[[Pool, PreparedBenchmark, Compute], Engine]] = {
    "auto": AutoEngine,
    "inline": InlineEngine,
    "processes": process_engine,
    "ray": ray_engine,
}


def check_pool(name: str, pool: Pool) -> None:
    """Refuse, before long work, a pool that an engine's workers could not open.

    Raises:
        InputError: there are none on this system, they could not import its architecture, or prepare its
            task vectors from its files.
    """
    if name == "processes":
        ensure_processes()
    if name in ("processes", "ray"):
        module_of(pool)
    if name == "processes":
        ensure_rebuildable(pool)


def make_engine(pool: Pool, benchmark: PreparedBenchmark, compute: Compute = HERE) -> Engine:
    """The engine that ``compute`` names; nothing starts before its first recipe.

    Raises:
        InputError: as :func:`check_pool`.
    """
    return _MAKERS[compute.engine](pool, benchmark, compute)


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
