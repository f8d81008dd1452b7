"""The comparisons on the real AnyNet pool: Stage 2 guided by one pair, and by several of other data sets."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pandas as pd
from kept import Job
from real_pairs import DATA, evaluators, opened
from trials import Trial, run_trials

import sfkit

EVALUATIONS = 300
MARKS = (40, 80, 150)
GUIDES = {
    "one": ("eth3d",),
    "mean": ("eth3d", "cones", "motorcycle"),
    "worst": ("eth3d", "cones", "motorcycle"),
    "folds": ("eth3d", "cones", "motorcycle", "reindeer"),
}
"""Name of a comparison -> the benchmarks, of one pair each, that guide both stages."""


def jobs() -> dict[str, Job]:
    """Name -> comparison; none without the real data."""
    if not os.environ.get(DATA):
        return {}
    found: dict[str, Job] = {}
    for seed in range(2):
        found |= {f"real-{name}-{seed}": partial(compared, name, seed) for name in GUIDES}
    return found


def trials(name: str) -> list[Trial]:
    """The ways to run Stage 2; four pairs of four data sets can be held out one at a time."""

    def settings(**guard: float) -> sfkit.RoutingSettings:
        return sfkit.RoutingSettings(evaluations=EVALUATIONS, converge=False, **guard)

    plain = [Trial("plain", settings()), Trial("plain, x / 2", settings(), shorten=0.5)]
    guarded = {"folds": Trial("4 folds", settings(holdout=4))}
    return [*plain, guarded.get(name, Trial("shrinkage 0.05", settings(shrinkage=0.05)))]


def compared(name: str, seed: int, folder: Path) -> pd.DataFrame:
    """Both stages guided as ``name`` says, judged on the other pairs; bad-1.0 in percent."""
    pool, guides = opened(), GUIDES[name]
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        found = {pair: evaluator.with_store(store) for pair, evaluator in evaluators().items()}
        scorer = sfkit.CombinedScorer(
            [found[guide] for guide in guides], "worst" if name == "worst" else "mean"
        )
        stage1 = sfkit.SubsetSettings(population=8, generations=3, seed=seed)
        subset = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, stage1).run().subset
        table = run_trials(trials(name), pool, subset, scorer, found, seeds=(seed,), marks=MARKS)
    table.insert(0, "guided by", "+".join(guides))
    table.insert(1, "how", name)
    table["subset"] = "+".join(subset)
    return table
