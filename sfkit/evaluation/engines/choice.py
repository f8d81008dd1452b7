"""Engines by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from sfkit.errors import InputError, unknown_name
from sfkit.evaluation.engines.auto import AutoEngine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.plan import ensure_rebuildable, module_of
from sfkit.evaluation.engines.processes import process_engine
from sfkit.evaluation.engines.ray_actors import ensure_ray, ray_engine
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.forward import ForwardMode
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

ENGINES = ("auto", "inline", "processes", "ray")


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


def check_engine(name: str, workers: int | None) -> None:
    """Refuse, before long work, an engine that cannot be had.

    Raises:
        InputError: an unknown engine, a number of workers it cannot have, or one whose library is not
            installed.
    """
    if name not in ENGINES:
        raise unknown_name("engine", name, ENGINES)
    if workers is not None and workers < 1:
        raise InputError(f"workers: found {workers}, expected at least 1")
    if name == "inline" and workers not in (None, 1):
        raise InputError(f"workers: found {workers}, engine 'inline' has one: choose 'processes' or 'ray'")
    if name == "ray":
        ensure_ray()


def check_pool(name: str, pool: Pool) -> None:
    """Refuse, before long work, a pool that an engine's workers could not open.

    Raises:
        InputError: they could not import its architecture, or prepare its task vectors from its files.
    """
    if name in ("processes", "ray"):
        module_of(pool)
    if name == "processes":
        ensure_rebuildable(pool)


def make_engine(
    name: str,
    pool: Pool,
    benchmark: PreparedBenchmark,
    *,
    device: str = "cpu",
    workers: int | None = None,
    mode: ForwardMode | None = None,
) -> Engine:
    """The engine called ``name``; nothing starts before its first recipe.

    Raises:
        InputError: as :func:`check_engine` and :func:`check_pool`.
    """
    check_engine(name, workers)
    if name == "inline":
        return InlineEngine(pool, benchmark, device=device, mode=mode)
    if name == "processes":
        return process_engine(pool, benchmark, device=device, workers=workers, mode=mode)
    if name == "ray":
        return ray_engine(pool, benchmark, device=device, workers=workers, mode=mode)
    return AutoEngine(pool, benchmark, device=device, workers=workers, mode=mode)
