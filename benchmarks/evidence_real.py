"""The comparisons on the real AnyNet pool: Stage 2 guided by one pair, and by several of other data sets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path

import pandas as pd
from kept import Job
from trials import Trial, run_trials

import sfkit
from sfkit.datasets import Benchmark
from sfkit.merging import Pool

POOL = Path(__file__).parents[1] / "tests" / "pools" / "anynet_real.toml"
EVALUATIONS = 300
MARKS = (40, 80, 150)
CODINGS = {"motorcycle": "npz:arr_0", "cones": "png8:4", "reindeer": "png8:2"}
GUIDES = {
    "one": ("eth3d",),
    "mean": ("eth3d", "cones", "motorcycle"),
    "worst": ("eth3d", "cones", "motorcycle"),
    "folds": ("eth3d", "cones", "motorcycle", "reindeer"),
}
"""Name of a comparison -> the benchmarks, of one pair each, that guide both stages."""
PAIRS = ("eth3d", "kitti2012", *CODINGS)


def jobs() -> dict[str, Job]:
    """Name -> comparison; none without the real data."""
    if "SFKIT_REAL_DATA" not in os.environ:
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


@lru_cache
def opened() -> Pool:
    """Five real checkpoints."""
    return sfkit.open_pool(POOL)


@lru_cache
def evaluators() -> dict[str, sfkit.Evaluator]:
    """Every pair as a benchmark of its own, by name."""
    return {name: sfkit.Evaluator(opened(), benchmark) for name, benchmark in benchmarks().items()}


def benchmarks() -> dict[str, Benchmark]:
    """ETH3D's playground, KITTI 2012's first pair (the sources may have seen it), Middlebury's three."""
    data = Path(os.environ["SFKIT_REAL_DATA"])
    public: Sequence[tuple[str, str]] = (("eth3d", "raft"), ("kitti2012", "all-valid"))
    found = {
        name: sfkit.open_benchmark(name, data / name, protocol=protocol, metric="bad-1.0")
        for name, protocol in public
    }
    for name, coding in CODINGS.items():
        found[name] = sfkit.open_benchmark("pairs", data / "pairs" / name, coding=coding, metric="bad-1.0")
    return found
