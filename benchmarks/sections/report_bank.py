"""What a report says of the sharp bank: methods tuned on one world and tested on three others."""

from __future__ import annotations

from functools import partial

from processes import RESULTS
from tabulated import markdown

import sfkit
from sfkit import analysis, bank, baselines
from sfkit.analysis import Study

FOLDER = RESULTS / "report_bank"
POOL = "bank-sharp"
LEFT_OUT = ("exhaustive",)
"""Needs every subset scored."""
POPULATION, GENERATIONS, EVALUATIONS, SEEDS, RESAMPLES = 10, 4, 30, 3, 200
GUIDES, TESTS = 8, 8
"""Pairs of the world that guides, and of each that does not."""


def worlds() -> list[str]:
    """What guides nothing."""
    return [f"{POOL}:{name}" for name in bank.benchmarks() if name != bank.VALIDATION]


def measure() -> Study:
    """The study that a report is made of; its store goes on where it was."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    experiment = analysis.Experiment(
        sfkit.open_pool(POOL),
        sfkit.open_benchmark(f"{POOL}:{bank.VALIDATION}", pairs=GUIDES),
        tuple(sfkit.open_benchmark(name, pairs=TESTS) for name in worlds()),
        sfkit.EvaluationStore(FOLDER / "evaluations.sqlite"),
        population=POPULATION,
        generations=GENERATIONS,
        evaluations=EVALUATIONS,
        resamples=RESAMPLES,
    )
    methods = [name for name in baselines.baselines() if name not in LEFT_OUT]
    return analysis.study(experiment, seeds=SEEDS, methods=methods, progress=partial(print, flush=True))


def section() -> str:
    """Its sentences and its tables."""
    study = measure()
    training, training_cpu = (bank.training_seconds(POOL, cpu=cpu) for cpu in (False, True))
    (_, joint), (_, joint_cpu) = (bank.joint_training(POOL, cpu=cpu) for cpu in (False, True))
    overhead = study.overhead_table(training, joint, training_cpu=training_cpu, joint_cpu=joint_cpu)
    return f"""## The report on the embedded bank

What a report says of the pool `{POOL}`, by its own calls (`analysis.study`, `analysis.summary`): 11
sources, M = {POPULATION}, T = {GENERATIONS}, {EVALUATIONS} evaluations of Stage 2, {SEEDS} seeds, all usual
baselines and the averaged winner of {RESAMPLES} resamples. {GUIDES} pairs of courtyard guide, {TESTS} pairs
each of three other worlds test. What it says first:

{tables(study, "on the mean of the unseen")}

What each method took, all its runs together, and beside joint retraining and the fine-tuning of the sources,
whose seconds were measured when `{POOL}` was built, on a machine that did other work: overheads
are of wall seconds by wall seconds, so look at the CPU seconds beside them too. What a search does between
its evaluations is not counted:

{markdown(study.cost_table(), digits=1)}

{markdown(overhead, digits=1)}"""


def tables(study: Study, where: str) -> str:
    """What a report says first, its methods, their differences to the best, and the sources."""
    said = "\n".join(f"- {sentence}" for sentence in analysis.summary(study))
    return f"""{said}

The methods, tuned on validation alone; `*` marks what guided them, `†` a row that chose by the mean of all:

{markdown(study.table())}

Against {study.reference} {where}, in points; `low` and `high` are the ends of the 95 %
interval of that difference alone, over images and, where a method draws, its seeds; the verdicts are
corrected for all {study.comparison.family} comparisons there:

{markdown(study.differences_table())}

Single sources:

{markdown(study.sources_table())}"""
