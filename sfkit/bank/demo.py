"""``sfkit demo``: both stages on the embedded bank, computed while you watch.

What is known before the search, the unseen benchmarks' pairs and every member's scores on them, is rendered
and computed in a second process meanwhile, so that both cores of a small machine have work.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import pandas as pd
import torch

from sfkit import bank
from sfkit.analysis import SearchVerdict, contenders, judges, search_verdict
from sfkit.bank.plan import MAIN
from sfkit.datasets import Benchmark
from sfkit.evaluation import EvaluationStore, Evaluator, pivot, score_recipes
from sfkit.evaluation.compute import HERE, PARAMETERS, Compute
from sfkit.evaluation.engines.spawned import SAFE_PATH
from sfkit.evaluation.table import write_table
from sfkit.merging import Pool, open_pool
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import search_pool, write_result
from sfkit.search.plan import SearchPlan
from sfkit.search.records import Generation, SubsetCandidate
from sfkit.search.run_folder import run_folder

NOTEBOOK = "01_quickstart"
TEST_PAIRS = 20
"""Of each unseen benchmark: half of them, so that two cores are done in two minutes."""

StepCallback = Callable[[str, int, int, str], None]
"""What is going on, how much of it is done, of how much, and the best so far."""


@dataclass(frozen=True)
class Budget:
    """How much the demo searches: a fraction of the paper's budget, which has M=50, T=15 and 300 trials."""

    population: int = 20
    generations: int = 6
    evaluations: int = 80

    @property
    def subsets(self) -> int:
        """Candidates Stage 1 proposes; repeated ones cost nothing."""
        return self.population * (self.generations + 1)

    def plan(self, seed: int) -> SearchPlan:
        """Both stages within this budget."""
        stage1 = SubsetSettings(population=self.population, generations=self.generations, seed=seed)
        return SearchPlan(stage1=stage1, stage2=RoutingSettings(evaluations=self.evaluations, seed=seed))


@dataclass(frozen=True)
class Demo:
    """What the demo found.

    Attributes:
        table: a row a network, a column a benchmark (bad-3.0 in percent), validation marked ``*``.
        subset: the sources Stage 1 chose.
        forward_passes: image pairs that went through a network.
        evaluations: recipes that were scored, on any benchmark, without those found in the store.
        seconds: wall time of everything.
        cpu_seconds: what this process and those it started took of processors meanwhile.
        merged: the merged network.
        report: the report; None where it was left out.
        scores: the table as CSV.
        verdict: what to deploy, beside base, the best single source and uniform.
        proposed: method -> the most evaluations of its search: the paper's in this budget, a model's own.
    """

    table: pd.DataFrame
    subset: tuple[str, ...]
    forward_passes: int
    evaluations: int
    seconds: float
    cpu_seconds: float
    merged: Path
    report: Path | None
    scores: Path
    verdict: SearchVerdict
    proposed: Mapping[str, int]


def demo(
    out: Path,
    *,
    seed: int = 0,
    budget: Budget = Budget(),
    compute: Compute = HERE,
    with_report: bool = True,
    progress: StepCallback = lambda *_: None,
    force: bool = False,
) -> Demo:
    """Search the bank's 11 sources on the quick validation pairs, then test on the unseen benchmarks.

    Writes what :func:`~sfkit.search.pipeline.search_pool` does, ``evaluations.sqlite``, ``scores.csv`` and
    ``report.html`` (the quickstart notebook run on the bank with the same seed and budget) into ``out``. What
    the store holds already is not computed again. ``compute`` says where and how networks run, ``force``
    whether a demo of another seed or budget in ``out`` may be replaced.

    Raises:
        InputError: ``out`` holds another search, or one that runs.
    """
    started, worked = time.perf_counter(), _processors()
    pool = open_pool(MAIN.pool_file)
    validation = bank.benchmark(bank.VALIDATION, quick=True, of=MAIN.benchmarks)
    path, plan = out / "evaluations.sqlite", budget.plan(seed)
    prepared = Evaluator(pool, validation, compute=compute)
    with (
        run_folder(out, plan.identity(pool, prepared), force=force) as folder,
        EvaluationStore(path) as store,
        _scored_meanwhile(path, compute) as known,
    ):
        # What an earlier run left is no pass of this one.
        held = {evaluation.key for evaluation in store}
        scorer = prepared.with_store(store)
        found = search_pool(pool, scorer, plan, folder, progress=_Steps(budget, progress))
        stage1 = cast(SubsetCandidate, found.stage1)  # the plan has both stages
        # From the end: the other process began at the front.
        for number, (name, scored) in enumerate(reversed(known.items())):
            progress("Members", number, len(known), name)
            if scored.cancel():  # not begun: done here, beside the other process
                _score_members(path, name, compute)
            else:
                scored.result()
        progress("Members", len(known), len(known), "")
        recipes = contenders(pool, {"Stage 1": stage1.recipe, "Stage 1+2": found.recipe})
        best = _single_best(pool, scorer)
        rows = {"base": recipes["base"], f"single best ({best})": pool.equal(best)}
        rows |= {name: recipes[name] for name in ("uniform", "Stage 1", "Stage 1+2")}
        benchmarks = [validation, *map(_unseen_pairs, _unseen())]
        parts = []
        for number, benchmark in enumerate(benchmarks):
            progress("Test", number, len(benchmarks), benchmark.name)
            guided = (validation.name,)
            parts.append(
                score_recipes(pool, rows, [benchmark], validation=guided, store=store, compute=compute)
            )
        progress("Test", len(benchmarks), len(benchmarks), "")
        table = pivot(pd.concat(parts, ignore_index=True))
        scores = write_table(table, out / "scores.csv")
        judged = search_verdict(
            pool, found.stages, *judges(scorer, benchmarks[1:]), evaluations=found.evaluations
        )  # all of it is in the store by now
        write_result(pool, found, {"verdict": judged.as_dict()})
        fresh = [len(evaluation.images) for evaluation in store if evaluation.key not in held]
    page = _report(out, seed, budget, compute, progress) if with_report else None
    seconds, worked = time.perf_counter() - started, _processors() - worked
    proposed = {"paper": plan, "bayesian": plan.by("bayesian")}
    most = {method: by.evaluations(pool.names, pool.blocks) for method, by in proposed.items()}
    return Demo(
        table,
        stage1.subset,
        sum(fresh),
        len(fresh),
        seconds,
        worked,
        found.merged,
        page,
        scores,
        judged,
        most,
    )


def _processors() -> float:
    """CPU seconds of this process and of those it started that have ended, theirs included."""
    return math.fsum(os.times()[:4])  # user and system, own and children's


def _unseen_pairs(name: str) -> Benchmark:
    return bank.benchmark(name, of=MAIN.benchmarks).first(TEST_PAIRS)


def _unseen() -> tuple[str, ...]:
    return tuple(name for name in bank.benchmarks() if name != bank.VALIDATION)


@contextmanager
def _scored_meanwhile(path: Path, compute: Compute) -> Iterator[dict[str, Future[None]]]:
    """Score the pool's members on the unseen benchmarks beside what the caller does, in one more process.

    That process computes in one thread, and the caller's network leaves it a core.
    """
    threads = torch.get_num_threads()
    # One core is left to the other process.
    torch.set_num_threads(max(1, min(threads, (os.cpu_count() or 1) - 1)))
    # Spawned: a fork would inherit torch's threads as they stand.
    spawned = multiprocessing.get_context("spawn")
    workers = ProcessPoolExecutor(1, mp_context=spawned, initializer=torch.set_num_threads, initargs=(1,))
    # For the process to come, which must import nothing from the working folder.
    former = {name: os.environ.get(name) for name in SAFE_PATH}
    os.environ.update(SAFE_PATH)
    try:
        scored = {name: workers.submit(_score_members, path, name, compute) for name in _unseen()}
    finally:
        for name, value in former.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
    try:
        yield scored
    finally:
        workers.shutdown(cancel_futures=True)
        torch.set_num_threads(threads)


def _score_members(path: Path, name: str, compute: Compute) -> None:
    """Base, each source and their equal mixture on one benchmark, into the store."""
    pool = open_pool(MAIN.pool_file)
    with EvaluationStore(path) as store:
        one = replace(compute, engine="inline", workers=None)  # this is a process beside others already
        score_recipes(pool, contenders(pool), [_unseen_pairs(name)], store=store, compute=one)


class _Steps:
    """The progress of a search as the demo shows it."""

    def __init__(self, budget: Budget, show: StepCallback) -> None:
        self._of = {"Stage 1": budget.subsets, "Stage 2": budget.evaluations}
        self._show = show

    def __call__(self, stage: str, generation: Generation[Any]) -> None:
        best = "" if generation.best is None else f"best {generation.best.score:.2f} %"
        self._show(stage, generation.counts.candidates, self._of[stage], best)


def _single_best(pool: Pool, scorer: Evaluator) -> str:
    """The source that scores best on the validation pairs: the one a user without merging would deploy."""
    outcomes = scorer([pool.equal(name) for name in pool.names])
    ranked = sorted(zip(outcomes, pool.names, strict=True), key=lambda pair: (pair[0].score, pair[1]))
    return ranked[0][1]


def _report(out: Path, seed: int, budget: Budget, compute: Compute, progress: StepCallback) -> Path:
    from sfkit.reports import (  # Jupyter takes seconds to import: only who wants a report waits
        notebook_path,
        report,
    )

    progress("Report", 0, 1, "")
    values = {
        "pool": MAIN.name,
        "report_on": [{"name": f"{MAIN.benchmarks}:{name}", "pairs": TEST_PAIRS} for name in _unseen()],
        "population": budget.population,
        "generations": budget.generations,
        "evaluations": budget.evaluations,
        "seed": seed,
        **{name: getattr(compute, name) for name in PARAMETERS},
        "out": str(out),
    }
    page = report(notebook_path(NOTEBOOK), values, out / "report.html")
    progress("Report", 1, 1, "")
    return page
