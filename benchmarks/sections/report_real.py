"""What a report says of real AnyNet checkpoints, two of them harmful: pairs of three data sets guide."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from processes import RESULTS
from real_pairs import SIZE, gather
from sections.report_bank import tables
from tabulated import markdown

import sfkit
from sfkit import analysis, baselines
from sfkit.analysis import Study

ROOT = Path(__file__).parents[2]
POOL = "tests/pools/anynet_real_six.toml"
LEFT_OUT = ("exhaustive",)
POPULATION, GENERATIONS, EVALUATIONS, SEEDS = 16, 6, 30, 3


def measure() -> Study:
    """The study that a report is made of; its store goes on where it was."""
    guides, unseen = gather(RESULTS / "real_pairs")
    store = RESULTS / "report_real" / "evaluations.sqlite"
    store.parent.mkdir(parents=True, exist_ok=True)
    experiment = analysis.Experiment(
        sfkit.open_pool(ROOT / POOL),
        sfkit.open_benchmark("pairs", guides, metric="bad-1.0"),
        (sfkit.open_benchmark("pairs", unseen, metric="bad-1.0"),),
        sfkit.EvaluationStore(store),
        population=POPULATION,
        generations=GENERATIONS,
        evaluations=EVALUATIONS,
    )
    methods = [name for name in baselines.baselines() if name not in LEFT_OUT]
    return analysis.study(experiment, seeds=SEEDS, methods=methods)


def section() -> str:
    """Its sentences and its tables."""
    study = measure()
    pool, (height, width) = study.experiment.pool, SIZE
    geometry = analysis.task_vector_geometry(pool)
    cosines = pd.DataFrame(geometry.cosines, index=pool.names, columns=pool.names).rename_axis("source")
    return f"""## The report on real AnyNet checkpoints

What a report says of the pool `{POOL}`, by its own calls (`analysis.study`, `analysis.summary`): six sources
of which two harm (`half_size`, `own_images`); M = {POPULATION}, T = {GENERATIONS}, {EVALUATIONS} evaluations
of Stage 2, {SEEDS} seeds; all usual baselines and the averaged winner of
200 resamples are compared. Pairs of three data sets guide (ETH3D's
playground, Middlebury's Cones and Reindeer). Six images of four others test, which no source was tuned on:
Middlebury's Motorcycle, three frames of SceneFlow (the base's training set), one each of InStereo2K and
TartanAir. Of images larger than {width} x {height} pixels that middle is taken. `all-valid` and bad-1.0
everywhere. What it says first:

{tables(study, "on what nobody saw")}

Which sources the seeds of both stages chose:

{markdown(study.selection().table())}

Cosines of the task vectors, by which the pool has fewer directions than sources, and how far each went, in
percent of the base's norm:

{markdown(cosines)}

{markdown(geometry.table(), digits=1)}

What each method took, all its runs together:

{markdown(study.cost_table(), digits=1)}"""
