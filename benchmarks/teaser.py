"""Retraining on the union of all data against merging, measured on a bank: the paper's figure 1.

    python benchmarks/teaser.py --pool bank-sharp             # its own joint network
    python benchmarks/teaser.py --pool bank-slim --joint joint.safetensors --seconds 7200
    python benchmarks/results.py teaser                       # write what is there into docs/results.md

The sources are merged by both stages, guided by pairs of the validation world alone; the joint network was
trained on all sources' scenes. All are judged on the three other worlds. Evaluations go through a store, so
that an interrupted run goes on.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import torch
from kept import RUNS
from processes import answered
from tabulated import markdown

import sfkit
from sfkit import bank
from sfkit.analysis.measured import Measured, measure_with
from sfkit.analysis.retraining import JOINT, retraining_against_merging
from sfkit.bank.plan import BANKS, bank_plan
from sfkit.checkpoints.spec import Member
from sfkit.evaluation.outcome import total_known
from sfkit.files import write_text
from sfkit.merging import open_pool
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import SearchResult, search_pool
from sfkit.search.plan import SearchPlan

FOLDER = RUNS / "teaser"
UNIFORM = "uniform"


def teaser(
    name: str,
    joint: Path,
    seconds: float,
    plan: SearchPlan,
    guides: int,
    tests: int,
    *,
    joint_cpu: float | None = None,
) -> pd.DataFrame:
    """A row a way to one network: its mean on the unseen worlds, and on each; and what it takes.

    Args:
        name: the bank.
        joint: the network that was trained on all sources' scenes.
        seconds: wall seconds of its training, on the machine the bank was trained on.
        plan: of the search.
        guides: pairs of the validation world that guide it.
        tests: pairs of each other world; all of them where there are fewer.
        joint_cpu: CPU seconds of that training, where they are known.
    """
    pool, of = open_pool(name), bank_plan(name).benchmarks
    retrained = open_pool(replace(pool.spec, sources=(Member("joint", joint),)))
    worlds = [bank.benchmark(world, of=of) for world in bank.benchmarks() if world != bank.VALIDATION]
    worlds = [world.first(min(tests, len(world))) for world in worlds]
    folder = FOLDER / name
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        guide = sfkit.Evaluator(pool, bank.benchmark(bank.VALIDATION, of=of).first(guides), store=store)
        found = search_pool(pool, guide, plan, folder / "search", force=True)
        judges = [sfkit.Evaluator(pool, world, store=store) for world in worlds]
        merged = measure_with(judges, {UNIFORM: pool.uniform(), **found.stages})
        alone = measure_with([j.with_pool(retrained) for j in judges], {JOINT: retrained.equal("joint")})
    measured = [
        replace(one, images={**other.images, **one.images}) for one, other in zip(merged, alone, strict=True)
    ]
    training, worked = (bank.training_seconds(name, cpu=cpu) for cpu in (False, True))
    longest = max(training, key=lambda source: training[source])
    spent = {JOINT: seconds, UNIFORM: training[longest]}
    cpu: dict[str, float | None] = {JOINT: joint_cpu, UNIFORM: worked[longest]}
    for stage in found.stages:
        wall, processors = _searching(found, stage)
        spent[stage] = training[longest] + wall
        cpu[stage] = total_known([worked[longest], processors])
    table = retraining_against_merging(measured, JOINT, spent, cpu_seconds=cpu).table()
    return table.join(_by_world(measured)).reset_index()


def _by_world(measured: list[Measured]) -> pd.DataFrame:
    scores = {one.benchmark: {name: one.score(name) for name in one.networks} for one in measured}
    return pd.DataFrame(scores).rename_axis("way")


def _searching(found: SearchResult, stage: str) -> tuple[float, float | None]:
    """Wall and CPU seconds of the evaluations that finding it took, when they were computed."""
    files = ["stage1.csv"] if stage == "Stage 1" else ["stage1.csv", "stage2.csv"]
    rows = pd.concat([pd.read_csv(found.folder / name) for name in files])
    columns = rows["key"], rows["seconds"], rows["cpu_seconds"]
    spent = {key: (wall, None if cpu != cpu else cpu) for key, wall, cpu in zip(*columns, strict=True)}
    if found.averaged is not None and stage not in ("Stage 1", "Stage 1+2"):
        last = found.averaged.outcome
        spent[last.key] = last.seconds, last.cpu_seconds
    return math.fsum(wall for wall, _ in spent.values()), total_known(cpu for _, cpu in spent.values())


def measure(
    pool: str = "bank-sharp",
    joint: Path | None = None,
    seconds: float | None = None,
    population: int = 20,
    generations: int = 8,
    evaluations: int = 100,
    resamples: int = 200,
    pairs: int = 8,
    tests: int = 40,
    seed: int = 0,
) -> pd.DataFrame:
    """Measure one bank, and keep the table.

    ``joint`` is its joint network unless it ships with one, ``seconds`` the wall time of that one's training;
    ``pairs`` guide, and ``tests`` are those of each unseen world.
    """
    if (joint is None) != (seconds is None):
        raise SystemExit("expected both of --joint and --seconds, or none: a time belongs to its network")
    torch.set_num_threads(1)  # as trainings were timed
    joint_cpu = None
    if joint is None or seconds is None:
        joint, seconds = bank.joint_path(pool), bank.joint_training(pool)[1]
        joint_cpu = bank.joint_training(pool, cpu=True)[1]
    plan = SearchPlan(
        stage1=SubsetSettings(population=population, generations=generations, seed=seed),
        stage2=RoutingSettings(evaluations=evaluations, seed=seed),
        resamples=resamples,
    )
    table = teaser(pool, joint, seconds, plan, pairs, tests, joint_cpu=joint_cpu)
    write_text(FOLDER / f"{pool}.csv", table.to_csv(index=False))
    return table


def section() -> str:
    """A table for each bank that ``benchmarks/teaser.py`` has measured.

    Raises:
        SystemExit: that is none.
    """
    files = {name: FOLDER / f"{name}.csv" for name in BANKS}
    parts = [_table(name, pd.read_csv(file)) for name, file in files.items() if file.is_file()]
    if not parts:
        raise SystemExit("nothing is measured yet: run python benchmarks/teaser.py --pool NAME first")
    return "\n\n".join([HEAD, *parts])


HEAD = """## Retraining on the union of all data, or merging

`python benchmarks/teaser.py --pool NAME`: the paper's figure 1. bad-3.0 in percent, lower is better, on three
worlds that guided nothing. Seconds are what it takes once a new source's data are there, in one thread: the
whole joint training, or the longest fine-tuning and the search's evaluations. Shares are of wall seconds by
wall seconds; the bank's trainings ran on a machine that did other work, so look at the CPU seconds too."""


def _table(name: str, frame: pd.DataFrame) -> str:
    return f"### `{name}`\n\n{markdown(frame.set_index('way'))}"


if __name__ == "__main__":
    answered(measure)
