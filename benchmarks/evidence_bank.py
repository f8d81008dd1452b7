"""The comparisons on the embedded bank: guards at several numbers of validation pairs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from kept import Job
from trials import Trial, run_trials

import sfkit
from sfkit.bank import VALIDATION, benchmark, benchmarks
from sfkit.bank.rendered import RenderedPair
from sfkit.datasets import Benchmark
from sfkit.merging import Pool
from sfkit.merging.partitions import WAYS, auto_partition

WORLDS = [name for name in benchmarks() if name != VALIDATION]
EVALUATIONS = 300
POPULATION, GENERATIONS = 12, 3  # Stage 1, the same for all ways to run Stage 2
UNSEEN_PAIRS = 20
MARKS = (40, 80, 150)
ROUTING_PAIRS = 10
SEEDS = {2: 5, 5: 5, 10: 5, 20: 4, 40: 3}
"""Validation pairs -> how many draws of pairs and searches; more cost too much on two cores."""


def jobs() -> dict[str, Job]:
    """Name -> comparison on the bank, the first seed of each first."""
    found: dict[str, Job] = {}
    for seed in range(max(SEEDS.values())):
        for pairs, count in SEEDS.items():
            if seed < count:
                found[f"guards-{pairs:02d}-{seed}"] = partial(compared, pairs, seed, trials(pairs), MARKS)
        if seed < 3:
            found[f"routing-{seed}"] = partial(compared, ROUTING_PAIRS, seed, routings(), ())
            found[f"partitions-{seed}"] = partial(partitions, seed)
    return found


def settings(**kind: Any) -> sfkit.RoutingSettings:
    """Of Stage 2, by whose budget all ways are run."""
    return sfkit.RoutingSettings(evaluations=EVALUATIONS, converge=False, **kind)


def trials(pairs: int) -> list[Trial]:
    """The ways to run Stage 2 with so many validation pairs."""
    found = [Trial("plain", settings()), Trial("plain, x / 2", settings(), shorten=0.5)]
    found.append(Trial("shrinkage 0.05", settings(shrinkage=0.05)))
    if pairs >= 4:
        found.append(Trial("hold-out 1/2", settings(holdout=0.5)))
    if 4 <= pairs <= 10:
        found += [Trial("4 folds", settings(holdout=4)), Trial("entropy 0.5", settings(entropy=0.5))]
    return found


def routings() -> list[Trial]:
    """Tied, low-rank and block-specific routing at one budget, the last with the entropy penalty as well."""
    return [
        Trial("tied", settings()),
        Trial("rank 1", settings(tied=False, rank=1)),
        Trial("rank 2", settings(tied=False, rank=2)),
        Trial("block-specific", settings(tied=False)),
        Trial("block-specific, entropy 0.5", settings(tied=False, entropy=0.5)),
        Trial("tied, entropy 0.5", settings(entropy=0.5)),
    ]


def partitions(seed: int, folder: Path) -> pd.DataFrame:
    """The architecture's blocks and those made from the network itself, tied and block-specific."""
    ways = {"architecture's": None, **{by: auto_partition(opened(), by=by) for by in WAYS}}
    kinds = {"tied": True, "block-specific": False}
    ours = [
        Trial(f"{way}, {kind}", settings(tied=tied), partition=partition)
        for way, partition in ways.items()
        for kind, tied in kinds.items()
    ]
    return compared(ROUTING_PAIRS, seed, ours, (), folder)


def compared(
    pairs: int, seed: int, ways: Sequence[Trial], marks: Sequence[int], folder: Path
) -> pd.DataFrame:
    """Both stages guided by ``pairs`` pairs of the validation world, drawn by the seed."""
    pool = opened()
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        scorer = sfkit.Evaluator(pool, drawn(pairs, seed), store=store)
        stage1 = sfkit.SubsetSettings(population=POPULATION, generations=GENERATIONS, seed=seed)
        subset = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, stage1).run().subset
        judges = {name: unseen.with_store(store) for name, unseen in unseen_evaluators().items()}
        table = run_trials(ways, pool, subset, scorer, judges, seeds=(seed,), marks=marks)
    table.insert(0, "pairs", pairs)
    table["subset"] = "+".join(subset)
    return table


def drawn(pairs: int, seed: int) -> Benchmark:
    """Pairs of the validation world, drawn by the seed."""
    order = np.random.default_rng([seed, 7]).permutation(40)
    return benchmark(VALIDATION).select([f"{VALIDATION}-{n:02d}" for n in sorted(order[:pairs])])


@lru_cache
def opened() -> Pool:
    """The bank."""
    return sfkit.open_pool("bank")


@lru_cache
def unseen_evaluators() -> dict[str, sfkit.Evaluator]:
    """New pairs of the validation world, under its name, then the other worlds'."""
    judged = {VALIDATION: new_pairs(), **{name: benchmark(name).first(UNSEEN_PAIRS) for name in WORLDS}}
    return {name: sfkit.Evaluator(opened(), judge) for name, judge in judged.items()}


def new_pairs() -> Benchmark:
    """Pairs of the validation world beyond the 40 of its benchmark."""
    known = benchmark(VALIDATION)
    pairs = tuple(RenderedPair(VALIDATION, len(known) + n) for n in range(UNSEEN_PAIRS))
    return Benchmark(
        name=f"{VALIDATION}-new",
        family=known.family,
        pairs=pairs,
        protocol=known.protocol,
        metric=known.metric,
    )
