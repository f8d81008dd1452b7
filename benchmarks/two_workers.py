"""A search by a model of the score with two worker processes and batches of two, beside one at a time.

    python benchmarks/two_workers.py

Both stages on the first bank, one thread a worker, as many evaluations either way, which take turns on the
same pairs. Speed-up is by the clock from the search's first step to its last file, workers warm; twice as
fast would be an efficiency of 1. What batches lose in evaluations is in ``optimum.py``, for more workers.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from itertools import accumulate
from pathlib import Path
from typing import Any

import torch
from processes import answered, call, shown
from tabulated import numbers

from sfkit import open_benchmark, open_pool
from sfkit.bank import VALIDATION
from sfkit.evaluation import Evaluator
from sfkit.search import BayesianRoutingSettings, BayesianSubsetSettings
from sfkit.search.pipeline import search_pool
from sfkit.search.plan import SearchPlan

DOCUMENT = "benchmarks/README.md"

WAYS = (("inline", 1), ("processes", 2))
"""Engine and workers; a batch has one proposal a worker."""


def measure(*, pairs: int = 8, evaluations: int = 40, turns: int = 4) -> list[dict[str, Any]]:
    """A row a search: engine, workers, seed, evaluations computed, seconds, best score, load at its end.

    ``curve`` has the best score so far after each candidate of Stage 2.

    Args:
        pairs: of the first bank's validation benchmark.
        evaluations: of Stage 2; Stage 1 has as many beside the sources alone.
        turns: searches each way, alternating, each with a seed of its own.
    """
    torch.set_num_threads(1)
    rows = []
    for seed in range(turns):
        for engine, workers in WAYS:
            rows.append(
                {
                    "engine": engine,
                    "workers": workers,
                    "seed": seed,
                    **timed(engine, workers, pairs, evaluations, seed),
                }
            )
    return rows


def timed(engine: str, workers: int, pairs: int, evaluations: int, seed: int) -> dict[str, Any]:
    """One search in a folder of its own."""
    pool, benchmark = open_pool("bank"), open_benchmark(f"bank:{VALIDATION}", pairs=pairs)
    first = len(pool.names) + 1
    plan = SearchPlan(
        stage1=BayesianSubsetSettings(
            population=first, generations=(evaluations - first) // workers, batch=workers, seed=seed
        ),
        stage2=BayesianRoutingSettings(evaluations=evaluations, batch=workers, seed=seed),
    )
    with (
        tempfile.TemporaryDirectory() as folder,
        Evaluator(pool, benchmark, engine=engine, workers=workers) as evaluator,
    ):
        evaluator.engine.start()
        evaluator([pool.equal(*pool.names[:2])])  # first forward passes prepare kernels
        began, before = time.perf_counter(), evaluator.counts.computed
        outcome = search_pool(pool, evaluator, plan, Path(folder))
        seconds = time.perf_counter() - began
        computed = evaluator.counts.computed - before
    assert outcome.routing is not None, "Stage 2 is asked for"
    return {
        "evaluations": computed,
        "seconds": seconds,
        "score": outcome.score,
        "curve": list(accumulate((c.score for c in outcome.routing.candidates), min)),
        "load": os.getloadavg()[0],
    }


COMMAND = ("two_workers.py", "--json")


def section() -> str:
    """A row a way, and the efficiency of two workers."""
    found = call(*COMMAND)
    rows, paces = [], {}
    for engine, workers in WAYS:
        part = [row for row in found if row["workers"] == workers]
        paces[workers] = statistics.median(row["seconds"] / row["evaluations"] for row in part)
        gained = paces[1] / paces[workers]
        rows.append(
            (
                f"{engine}, {workers} worker{'s' * (workers > 1)}, batch {workers}",
                len(part),
                f"{statistics.median(row['evaluations'] for row in part):.0f}",
                f"{statistics.median(row['seconds'] for row in part):.1f}",
                f"{gained:.2f}",
                f"{100 * gained / workers:.0f} %",
                f"{statistics.median(needed(row, found) for row in part):.0f}",
                ", ".join(f"{row['score']:.2f}" for row in part),
                f"{statistics.mean(row['load'] for row in part):.1f}",
            )
        )
    heads = (
        "search",
        "searches",
        "evaluations",
        "seconds",
        "speed-up",
        "efficiency",
        "Stage 2 needs",
        "best scores",
        "load average",
    )
    return f"""## A model's search by two real workers

`{shown(*COMMAND)}`: both stages by a model of the score on the first bank, one thread a worker. Speed-up
is of the seconds an evaluation, by the clock, medians. `Stage 2 needs` is how many of its evaluations it
took for the score that all searches of the same seed reach, median; best scores are bad-3.0, a search each.
The load average is the machine's over the last minute, these searches included.

{numbers(heads, rows)}"""


def needed(row: dict[str, Any], found: list[dict[str, Any]]) -> int:
    """Evaluations of Stage 2 until the score that all searches of the same seed reach."""
    common = max(other["curve"][-1] for other in found if other["seed"] == row["seed"])
    return next(number for number, score in enumerate(row["curve"], start=1) if score <= common)


if __name__ == "__main__":
    answered(measure)
