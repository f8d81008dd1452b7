"""Where a whole search spends its time: the network's forward passes, and all the rest by what it does.

    python benchmarks/overhead.py
    python benchmarks/overhead.py --bank
    python benchmarks/overhead.py --pairs 8 --population 50 --generations 15 --evaluations 300 --json
    python benchmarks/overhead.py --method bayesian --generations 41 --evaluations 80
    python benchmarks/overhead.py --method bayesian --generations 41 --evaluations 80 --known 400

Both stages run on 11 sources of AnyNet, inline, over pairs of noise of 256 x 512 in memory, with store,
journal, tables and merged file on disk: AnyNet as published, with random weights, or the first bank's,
which has a third of the disparities and no propagation stage, so that the rest weighs more. By default there
are as many pairs as the paper validates on, and fewer evaluations: a minute on one core. Every function below
is timed without what it calls of the others, so that the rows add up. Reading the pool and preparing images
happen before the search and are a row of their own; ``search`` is whatever no other row claims: breeding,
CMA-ES, ranking, the evaluator's own work, and waiting for the errors of the last pair. The others are counted
in a thread of their own while the network runs: they take computing, and no time by the clock. ``--known``
puts so many merges into the store before, with errors that are made up, as an earlier search would have left
them: the model learns from these, too.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from processes import answered, call, shown
from synthetic_pool import PoolShape, describe, write_checkpoints
from tabulated import numbers

from sfkit.architectures import InputConvention
from sfkit.bank import pool_path
from sfkit.datasets.benchmark import Benchmark, memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.evaluation.store import Evaluation, evaluation_key
from sfkit.merging import Pool, open_pool
from sfkit.merging.live import LiveModel
from sfkit.search import (
    BayesianRoutingSearch,
    BayesianRoutingSettings,
    BayesianSubsetSearch,
    BayesianSubsetSettings,
    Journal,
    RoutingSettings,
    SubsetSettings,
    pipeline,
)
from sfkit.search.pipeline import search_pool
from sfkit.search.plan import METHODS, SearchPlan

DOCUMENT = "benchmarks/README.md"

PUBLISHED = PoolShape("anynet", sources=11)
SIZE = (256, 512)
FORWARD, SEARCH, BEFORE = "forward passes", "search", "open pool, prepare images (before)"
PARTS: tuple[tuple[str, Any, str], ...] = (
    ("merge", LiveModel, "apply"),
    ("around the network", LiveModel, "disparity"),
    ("errors of predictions", PreparedBenchmark, "errors"),
    ("prepare images", InputConvention, "prepare"),
    ("store: look up", EvaluationStore, "get"),
    ("store: write", EvaluationStore, "put"),
    ("keys", Evaluator, "describe"),
    ("scores", Evaluator, "outcome"),
    ("journal", Journal, "write"),
    ("merged file", pipeline, "save_merged"),
    ("model of subsets", BayesianSubsetSearch, "_proposed"),
    ("model of routings", BayesianRoutingSearch, "_proposed"),
)
"""What is timed: the row it counts for, where it lives, and its name."""


class Clock:
    """Seconds by row, by the clock and of computing, without those of rows inside it.

    What other threads do meanwhile costs computing, and no time by the clock.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.computing: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._own = threading.get_ident()
        self._row, self._since, self._computed = SEARCH, time.perf_counter(), time.thread_time()

    @contextmanager
    def row(self, name: str) -> Iterator[None]:
        """Everything in here counts for that row."""
        outer = self.turn(name)
        self.calls[name] += 1
        try:
            yield
        finally:
            self.turn(outer)

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted for that row."""

        def call(*arguments: Any, **named: Any) -> Any:
            if threading.get_ident() == self._own:
                with self.row(name):
                    return function(*arguments, **named)
            started = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                self.seconds[name] += 0.0  # a row of its own
                self.computing[name] += time.thread_time() - started
                self.calls[name] += 1

        return call

    def turn(self, name: str) -> str:
        """Count up to now, from now on for another row; the row before."""
        now, computed = time.perf_counter(), time.thread_time()
        self.seconds[self._row] += now - self._since
        self.computing[self._row] += computed - self._computed
        before, self._row, self._since, self._computed = self._row, name, now, computed
        return before


def measure(
    pairs: int = 27,
    population: int = 10,
    generations: int = 2,
    evaluations: int = 20,
    method: str = METHODS[0],
    bank: bool = False,
    known: int = 0,
) -> dict[str, Any]:
    """Run a search; seconds and calls a row, the evaluations computed, and the share outside the network.

    Shares are of time by the clock, waiting for the disk included, and (``computing``) of the computing of
    all threads, which other work on the machine changes less. ``known`` merges are in the store before, with
    errors that are made up. ``evaluations`` are those of Stage 2; by a
    model, ``population`` subsets are scored before there is one.

    Raises:
        SystemExit: a disparity map was not finite: counting its errors is no work.
    """
    torch.set_num_threads(1)
    which, how = (
        (SubsetSettings, RoutingSettings)
        if method == "paper"
        else (BayesianSubsetSettings, BayesianRoutingSettings)
    )
    plan = SearchPlan(
        stage1=which(population=population, generations=generations), stage2=how(evaluations=evaluations)
    )
    with tempfile.TemporaryDirectory() as name, ExitStack() as patched:
        folder = Path(name)
        path = pool_path() if bank else published(folder)
        clock = Clock()
        with clock.row(BEFORE):
            pool, validation = open_pool(path), noise(pairs)
            scorer = Evaluator(pool, validation, store=EvaluationStore(folder / "e.sqlite"))
            scorer([pool.equal(*pool.names[:2])])  # first forward passes prepare kernels
            fill(scorer, pool, known)
        for row, place, called in PARTS:
            timed = clock.timed(row, getattr(place, called))
            patched.enter_context(mock.patch.object(place, called, timed))
        network = scorer.engine.worker.model.network  # type: ignore[attr-defined]
        patched.enter_context(mock.patch.object(network, "forward", clock.timed(FORWARD, network.forward)))
        search_pool(pool, scorer, plan, folder / "run")
        clock.turn(SEARCH)
        flagged = any(image.flagged for evaluation in scorer.store for image in evaluation.images)
        scorer.store.close()
    if flagged:
        raise SystemExit("a disparity map was not finite: the share outside the network would be too small")
    before, _ = clock.seconds.pop(BEFORE), clock.computing.pop(BEFORE)
    total, computed = sum(clock.seconds.values()), sum(clock.computing.values())
    return {
        "network": "the first bank's AnyNet" if bank else "AnyNet as published",
        "method": method,
        "pairs": pairs,
        "known": known,
        "evaluations": scorer.counts.computed,
        "seconds": total,
        "cpu_seconds": computed,
        "before": before,
        "outside": 1 - clock.seconds[FORWARD] / total,
        "outside_computing": 1 - clock.computing[FORWARD] / computed,
        "rows": [
            {
                "part": part,
                "seconds": seconds,
                "share": seconds / total,
                "computing": clock.computing[part] / computed,
                "calls": clock.calls[part],
            }
            for part, seconds in sorted(clock.seconds.items(), key=lambda entry: -entry[1])
        ],
    }


def published(folder: Path) -> Path:
    """A pool of AnyNets as published, with random weights."""
    write_checkpoints(folder, PUBLISHED)
    return describe(folder, PUBLISHED, PUBLISHED.sources)


def noise(pairs: int) -> Benchmark:
    """Pairs of noise with a true disparity of 20 px."""
    rng = np.random.default_rng(0)
    truth = np.full(SIZE, 20.0, np.float32)
    images = rng.integers(0, 256, (pairs, 2, *SIZE, 3), dtype=np.uint8)
    return memory_benchmark(
        "noise", [Sample(f"{n}", left, right, truth) for n, (left, right) in enumerate(images)]
    )


def fill(scorer: Evaluator, pool: Pool, count: int) -> None:
    """Store so many more merges of random subsets, the errors of the one that is there moved at random."""
    (template,), rng = tuple(scorer.store), np.random.default_rng(0)
    met = {frozenset(pool.names[:2])}
    while len(met) <= count:
        subset = frozenset(name for name in pool.names if rng.random() < 0.5)
        if len(subset) < 2 or subset in met:
            continue
        met.add(subset)
        description = scorer.describe(pool.equal(*sorted(subset, key=pool.names.index)))
        images = tuple(moved(image, rng.uniform(0.5, 1.0)) for image in template.images)
        scorer.store.put(Evaluation(evaluation_key(description), description, images, None, 0.0))


def moved(image: ImageErrors, factor: float) -> ImageErrors:
    """An image with that share of its bad pixels."""
    regions = {
        name: replace(region, above=tuple(int(factor * count) for count in region.above))
        for name, region in image.regions.items()
    }
    return replace(image, regions=regions)


MODEL = ("--method", "bayesian", "--generations", "41", "--evaluations", "80")
COMMANDS = (
    ("overhead.py", "--json"),
    ("overhead.py", "--bank", "--json"),
    ("overhead.py", *MODEL, "--json"),
    ("overhead.py", *MODEL, "--known", "400", "--json"),
)


def section() -> str:
    """One table a network, one row a part of a search."""
    tables = [f"`{shown(*command)}`: {table(call(*command))}" for command in COMMANDS]
    return "\n\n".join([HEAD, *tables])


HEAD = """## Overhead of a search

Both stages on pairs of 256 x 512, as many as the paper validates on. `search` is what no other row
claims: breeding, CMA-ES, ranking, the evaluator's own work. A search by a model of the score is
run whole, since the model's part grows with what it learns from, and once more where the store holds 400
merges before, the most that a model learns from. Errors are counted in a thread of
their own while the network runs, which takes computing and no time. Shares of computing leave out
waiting for the disk."""


def table(found: dict[str, Any]) -> str:
    """What one measurement found."""
    heads = ("part", "share, %", "of computing, %", "ms an evaluation", "calls")
    rows = [
        (
            r["part"],
            f"{100 * r['share']:.2f}",
            f"{100 * r['computing']:.2f}",
            f"{1e3 * r['seconds'] / found['evaluations']:.2f}",
            f"{r['calls']:,}",
        )
        for r in found["rows"]
    ]
    known = f", {found['known']} merges known before" if found["known"] else ""
    return f"""{found["network"]}, {found["pairs"]} pairs, {found["method"]} method{known},
{found["evaluations"]} evaluations in {found["seconds"]:.0f} s ({found["cpu_seconds"]:.0f} s of CPU), of which
**{100 * found["outside"]:.1f} %** lie outside the network's forward passes
({100 * found["outside_computing"]:.1f} % of computing). Pool and
images were made ready before, once, in {found["before"]:.1f} s.

{numbers(heads, rows)}"""


if __name__ == "__main__":
    answered(measure)
