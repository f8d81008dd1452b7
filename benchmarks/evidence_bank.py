"""The comparisons on the embedded banks: guards at several numbers of validation pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from kept import Job
from stage2_worlds import BANK_WINDOW, window
from trials import Trial, run_trials

import sfkit
from sfkit.bank import VALIDATION, benchmark, benchmarks
from sfkit.bank.plan import bank_plan
from sfkit.bank.rendered import RenderedPair
from sfkit.datasets import Benchmark
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.merging import Pool
from sfkit.merging.blocks import WAYS
from sfkit.merging.partitions import auto_partition

WORLDS = [name for name in benchmarks() if name != VALIDATION]
POPULATION, GENERATIONS = 12, 3  # Stage 1, the same for all ways to run Stage 2


@dataclass(frozen=True, eq=False)
class EvidenceStudy:
    """A bank, and how much is spent on comparing the ways to run Stage 2 there.

    Attributes:
        bank: its name.
        evaluations: of every Stage 2.
        unseen: pairs of every world that judge.
        window: (height, width) pixels that are taken from the middle of every pair; None for whole pairs.
        marks: evaluations after which the plain search is judged on its way.
        seeds: validation pairs -> draws of pairs and searches; more cost too much on two cores.
        ways: the ways to run Stage 2 that are compared, of those in :func:`trials`.
        routing_pairs: that guide tied and block-specific routing, and the ways to cut into blocks.
        routing_seeds: draws of these.
    """

    bank: str
    evaluations: int
    unseen: int
    window: tuple[int, int] | None
    marks: tuple[int, ...]
    seeds: Mapping[int, int]
    ways: tuple[str, ...]
    routing_pairs: int
    routing_seeds: int


FEW = ("plain", "plain, x / 2", "shrinkage 0.05", "hold-out 1/2")
WAYS_TO_GUARD = (*FEW, "4 folds", "entropy 0.5")
FIRST = EvidenceStudy(
    "bank", 300, 20, None, (40, 80, 150), {2: 5, 5: 5, 10: 5, 20: 4, 40: 3}, WAYS_TO_GUARD, 10, 3
)
SHARP = EvidenceStudy("bank-sharp", 60, 10, BANK_WINDOW, (20, 40), {2: 10, 5: 10, 10: 10}, FEW, 5, 5)


def jobs(study: EvidenceStudy = FIRST) -> dict[str, Job]:
    """Name -> comparison on a bank, the first seed of each first."""
    found: dict[str, Job] = {}
    for seed in range(max(study.seeds.values())):
        for pairs, count in study.seeds.items():
            if seed < count:
                ways = [way for way in trials(pairs, study.evaluations) if way.name in study.ways]
                found[f"guards-{pairs:02d}-{seed}"] = partial(compared, study, pairs, seed, ways, study.marks)
        if seed < study.routing_seeds:
            ways = routings(study.evaluations)
            found[f"routing-{seed}"] = partial(compared, study, study.routing_pairs, seed, ways, ())
            found[f"partitions-{seed}"] = partial(partitions, study, seed)
    return found


def settings(evaluations: int, **kind: Any) -> sfkit.RoutingSettings:
    """Of Stage 2, by whose budget all ways are run."""
    return sfkit.RoutingSettings(evaluations=evaluations, converge=False, **kind)


def trials(pairs: int, evaluations: int) -> list[Trial]:
    """The ways to run Stage 2 with so many validation pairs."""
    of = partial(settings, evaluations)
    found = [Trial("plain", of()), Trial("plain, x / 2", of(), shorten=0.5)]
    found.append(Trial("shrinkage 0.05", of(shrinkage=0.05)))
    if pairs >= 4:
        found.append(Trial("hold-out 1/2", of(holdout=0.5)))
    if 4 <= pairs <= 10:
        found += [Trial("4 folds", of(holdout=4)), Trial("entropy 0.5", of(entropy=0.5))]
    return found


def routings(evaluations: int) -> list[Trial]:
    """Tied, low-rank and block-specific routing at one budget, the last with the entropy penalty as well."""
    of = partial(settings, evaluations)
    return [
        Trial("tied", of()),
        Trial("rank 1", of(tied=False, rank=1)),
        Trial("rank 2", of(tied=False, rank=2)),
        Trial("block-specific", of(tied=False)),
        Trial("block-specific, entropy 0.5", of(tied=False, entropy=0.5)),
        Trial("tied, entropy 0.5", of(entropy=0.5)),
    ]


def partitions(study: EvidenceStudy, seed: int, folder: Path) -> pd.DataFrame:
    """The architecture's blocks and those made from the network itself, tied and block-specific."""
    ways = {"architecture's": None, **{by: auto_partition(opened(study.bank), by=by) for by in WAYS}}
    kinds = {"tied": True, "block-specific": False}
    ours = [
        Trial(f"{way}, {kind}", settings(study.evaluations, tied=tied), partition=partition)
        for way, partition in ways.items()
        for kind, tied in kinds.items()
    ]
    return compared(study, study.routing_pairs, seed, ours, (), folder)


def compared(
    study: EvidenceStudy, pairs: int, seed: int, ways: Sequence[Trial], marks: Sequence[int], folder: Path
) -> pd.DataFrame:
    """Both stages guided by ``pairs`` pairs of the validation world, drawn by the seed."""
    pool = opened(study.bank)
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        scorer = sfkit.Evaluator(pool, drawn(study, pairs, seed), store=store)
        stage1 = sfkit.SubsetSettings(population=POPULATION, generations=GENERATIONS, seed=seed)
        subset = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, stage1).run().subset
        unseen = unseen_evaluators(study)
        judges = {name: judge.with_store(store) for name, judge in unseen.items()}
        table = run_trials(ways, pool, subset, scorer, judges, seeds=(seed,), marks=marks)
    table.insert(0, "pairs", pairs)
    table["subset"] = "+".join(subset)
    return table


@cache
def opened(bank: str) -> Pool:
    """The bank of that name."""
    return sfkit.open_pool(bank)


@cache
def unseen_evaluators(study: EvidenceStudy) -> dict[str, sfkit.Evaluator]:
    """New pairs of the validation world, under its name, then of the other worlds."""
    judged = {VALIDATION: new_pairs(study)}
    judged |= {name: cut(world(study, name).first(study.unseen), study.window) for name in WORLDS}
    return {name: sfkit.Evaluator(opened(study.bank), judge) for name, judge in judged.items()}


def drawn(study: EvidenceStudy, pairs: int, seed: int) -> Benchmark:
    """Pairs of the validation world, drawn by the seed."""
    known = world(study, VALIDATION)
    order = np.random.default_rng([seed, 7]).permutation(len(known))
    chosen = known.select([f"{VALIDATION}-{n:02d}" for n in sorted(order[:pairs])])
    return cut(chosen, study.window)


def new_pairs(study: EvidenceStudy) -> Benchmark:
    """Pairs of the validation world beyond the 40 of its benchmark."""
    known = world(study, VALIDATION)
    pairs = tuple(RenderedPair(VALIDATION, len(known) + n) for n in range(study.unseen))
    whole = Benchmark(
        name=f"{VALIDATION}-new",
        family=known.family,
        pairs=pairs,
        protocol=known.protocol,
        metric=known.metric,
    )
    return cut(whole, study.window)


def world(study: EvidenceStudy, name: str) -> Benchmark:
    """A world's benchmark as the bank's pool is scored on it."""
    return benchmark(name, of=bank_plan(study.bank).benchmarks)


def cut(whole: Benchmark, size: tuple[int, int] | None) -> Benchmark:
    """The middle of every pair, or the benchmark as it is."""
    if size is None:
        return whole
    pairs = [window(pair.load(), size) for pair in whole.pairs]
    return memory_benchmark(f"{whole.name}-windows", pairs, protocol=whole.protocol, metric=whole.metric)
