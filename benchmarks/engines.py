"""Engines against each other: how much of every added worker is gained, and what an engine costs by itself.

    python benchmarks/engines.py
    python benchmarks/engines.py --engines inline processes --workers 1 2 4 --json

Subsets of the first bank are scored with one thread a worker, so that an engine with as many workers
as there are idle cores would have an efficiency of 1. Two amounts of work: many subsets, and three, which
two workers finish together only because images are shared out. Starting is timed by itself. Every engine
must give the scores of the inline engine to the last bit. Ray is left out where it is not installed.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations, islice
from typing import Any

import torch
from pictures import bars, picture
from processes import answered, call, shown
from tabulated import numbers

from sfkit import open_benchmark, open_pool
from sfkit.bank import VALIDATION
from sfkit.evaluation import Evaluator

DOCUMENT = "benchmarks/README.md"

FEW = 3


def measure(
    engines: tuple[str, ...] = ("inline", "processes", "ray"),
    workers: tuple[int, ...] = (1, 2),
    evaluations: int = 24,
    pairs: int = 8,
) -> list[dict[str, Any]]:
    """A row an engine, number of workers and amount of work, beside the inline engine on the same work.

    ``seconds`` are from the call with the subsets to the last score, ``busy`` those that workers spent in
    merges and forward passes, summed; ``overhead_ms`` an evaluation is time in which no worker computed:
    store, messages, waiting at the end. ``efficiency`` is what each worker achieves of what one does inline.

    Raises:
        SystemExit: an engine gave another score than inline.
    """
    torch.set_num_threads(1)
    rows = []
    for amount in (evaluations, FEW):
        inline, expected = timed("inline", 1, amount, pairs)
        for engine in engines:
            counts = (1,) if engine == "inline" else workers
            for count in counts if engine != "ray" or importlib.util.find_spec("ray") else ():
                inlined = engine == "inline"
                row, scores = (inline, expected) if inlined else timed(engine, count, amount, pairs)
                if scores != expected:
                    raise SystemExit(f"{engine} with {count} workers gave other scores than inline")
                ratio = row["seconds"] / inline["seconds"]
                rows.append({**row, "of_inline": ratio, "efficiency": 1 / ratio / count})
    return rows


def timed(engine: str, workers: int, evaluations: int, pairs: int) -> tuple[dict[str, Any], list[float]]:
    """Start an engine, warm it up with one subset, then time the others; their scores as well."""
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
        seconds = time.perf_counter() - ready
    busy = sum(outcome.seconds for outcome in outcomes)
    row = {
        "engine": engine,
        "workers": workers,
        "evaluations": evaluations,
        "start": started - began,
        "seconds": seconds,
        "busy": busy,
        "each": seconds / evaluations,
        "overhead_ms": 1e3 * (seconds - busy / workers) / evaluations,
    }
    return row, [outcome.score for outcome in outcomes]


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
    heads = ("engine", "workers", "evaluations", "start, s", "all, s", "of inline", "efficiency")
    shapes = ("{start:.1f}", "{seconds:.2f}", "{of_inline:.2f}", "{efficiency:.2f}", "{overhead_ms:.1f}")
    cells = [(*(r[n] for n in heads[:3]), *(shape.format(**r) for shape in shapes)) for r in rows]
    return f"""## Engines: inline, worker processes, Ray

`{shown(*COMMAND)}`: subsets of the first bank, one thread a worker, scores equal to the last
bit. Efficiency is what each worker achieves of what one does inline; overhead is time in which
no worker computed.

{picture(figure, "engines", "Efficiency of engines by number of workers")}

{numbers((*heads, "overhead, ms each"), cells)}"""


if __name__ == "__main__":
    answered(measure)
