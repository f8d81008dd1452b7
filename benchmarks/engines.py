"""Engines against each other: how much of every added worker is gained, and what an engine costs by itself.

    python benchmarks/engines.py
    python benchmarks/engines.py --engines inline processes --workers 1 2 4 --json

Subsets of the embedded bank are scored with one thread a worker, so that an engine with as many workers
as there are idle cores would have an efficiency of 1. Two amounts of work: many subsets, and three, which
two workers finish together only because images are shared out. Starting is timed by itself. Every engine
must give the scores of the inline engine to the last bit.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import combinations, islice
from typing import Any

import torch
from pictures import bars, picture
from processes import call, shown
from stages import answered

from sfkit import open_benchmark, open_pool
from sfkit.bank import VALIDATION
from sfkit.evaluation import Evaluator

DOCUMENT = "benchmarks/README.md"

ENGINES = ("inline", "processes", "ray")
WORKERS = (1, 2)
FEW = 3


@dataclass(frozen=True)
class EngineRun:
    """One engine with one number of workers on one amount of work.

    Attributes:
        engine: its name.
        workers: how many.
        evaluations: how many subsets were scored.
        start: seconds until all workers were ready.
        seconds: from the call with the subsets to the last score.
        busy: seconds that workers spent in merges and forward passes, summed.
        scores: one a subset.
    """

    engine: str
    workers: int
    evaluations: int
    start: float
    seconds: float
    busy: float
    scores: tuple[float, ...]

    @property
    def overhead_ms(self) -> float:
        """Milliseconds an evaluation in which no worker computed: store, messages, waiting at the end."""
        return 1e3 * (self.seconds - self.busy / self.workers) / self.evaluations

    def efficiency(self, inline: EngineRun) -> float:
        """What each worker achieves of what one does inline."""
        return inline.seconds / self.seconds / self.workers


def measure(
    *,
    engines: Sequence[str] = ENGINES,
    workers: Sequence[int] = WORKERS,
    evaluations: int = 24,
    pairs: int = 8,
) -> list[tuple[EngineRun, EngineRun]]:
    """Each engine with each number of workers, beside the inline engine on the same work.

    Ray is left out where it is not installed.

    Raises:
        RuntimeError: an engine gave another score than inline.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    found = []
    try:
        for amount in (evaluations, FEW):
            inline = timed("inline", 1, amount, pairs)
            for engine in engines:
                counts = (1,) if engine == "inline" else workers
                if engine == "ray" and importlib.util.find_spec("ray") is None:
                    counts = ()
                for count in counts:
                    run = inline if engine == "inline" else timed(engine, count, amount, pairs)
                    if run.scores != inline.scores:
                        raise RuntimeError(f"{engine} with {count} workers gave other scores than inline")
                    found.append((run, inline))
    finally:
        torch.set_num_threads(before)
    return found


def timed(engine: str, workers: int, evaluations: int, pairs: int) -> EngineRun:
    """Start an engine, warm it up with one subset, then time the others."""
    pool, benchmark = open_pool("bank"), open_benchmark(f"bank:{VALIDATION}", pairs=pairs)
    first, *rest = islice(combinations(pool.names, 4), evaluations + 1)
    with (
        ray_for(engine, workers),
        Evaluator(pool, benchmark, engine=engine, workers=workers) as evaluator,
    ):
        began = time.perf_counter()
        evaluator.engine.start()
        started = time.perf_counter()
        evaluator([pool.equal(*first)])  # first forward passes prepare kernels
        ready = time.perf_counter()
        outcomes = evaluator([pool.equal(*names) for names in rest])
        ended = time.perf_counter()
    busy = sum(outcome.seconds for outcome in outcomes)
    scores = tuple(outcome.score for outcome in outcomes)
    return EngineRun(engine, workers, evaluations, started - began, ended - ready, busy, scores)


@contextmanager
def ray_for(engine: str, cpus: int) -> Iterator[None]:
    """A Ray of that many CPUs on this machine alone, for the engine that needs one."""
    if engine != "ray":
        yield
        return
    import ray

    ray.init(
        address="local",  # one of our own, also where another Ray runs
        num_cpus=cpus,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="error",
        _node_ip_address="127.0.0.1",
    )
    yield
    ray.shutdown()


def row(run: EngineRun, inline: EngineRun) -> dict[str, Any]:
    """Plain values of a run and its ratios to the inline engine."""
    values = {key: value for key, value in asdict(run).items() if key != "scores"}
    return {
        **values,
        "each": run.seconds / run.evaluations,
        "of_inline": run.seconds / inline.seconds,
        "efficiency": run.efficiency(inline),
        "overhead_ms": run.overhead_ms,
    }


def rows(**options: Any) -> list[dict[str, Any]]:
    """What :func:`measure` says, as plain values."""
    return [row(run, inline) for run, inline in measure(**options)]


OPTIONS = {"engines": ENGINES, "workers": WORKERS, "evaluations": 24, "pairs": 8}


COMMAND = ("engines.py", "--json")


def section() -> str:
    """One row an engine, number of workers and amount of work."""
    rows = call(*COMMAND)
    most, few = sorted({r["evaluations"] for r in rows}, reverse=True)
    values: dict[str, dict[str, float]] = {}
    for r in rows:
        label = f"{r['engine']}, {r['workers']} worker{'s' * (r['workers'] > 1)}"
        values.setdefault(label, {})[f"{r['evaluations']} evaluations"] = r["efficiency"]
    figure = bars(
        values,
        title="How much of every worker is gained?",
        subtitle=f"efficiency against inline, {most} and {few} evaluations, on {os.cpu_count()} cores",
        x="efficiency (1 is a whole inline worker each)",
    )
    lines = [
        "## Engines: inline, worker processes, Ray",
        "",
        f"`{shown(*COMMAND)}`: subsets of the embedded bank, one thread a worker, scores equal to the last "
        "bit. Efficiency is what each worker achieves of what one does inline; overhead is time in which "
        "no worker computed.",
        "",
        picture(figure, "engines", "Efficiency of engines by number of workers"),
        "",
        "| engine | workers | evaluations | start, s | all, s | of inline | efficiency | overhead, ms each |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for r in rows:
        lines.append(
            f"| {r['engine']} | {r['workers']} | {r['evaluations']} | {r['start']:.1f} | {r['seconds']:.2f} "
            f"| {r['of_inline']:.2f} | {r['efficiency']:.2f} | {r['overhead_ms']:.1f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    answered(__doc__, rows, OPTIONS)
