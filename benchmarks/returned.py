"""What should a search return: the best on its few validation pairs, or the average of what wins resamples?

    python benchmarks/returned.py --minutes 30        # go on with what is missing, at most so long
    python benchmarks/returned.py real                # a part of it
    python benchmarks/returned.py --list              # what there is to do, and what is done
    python benchmarks/results.py returned             # write what is there into docs/results.md

A run is both stages guided by a few pairs: on the banks drawn anew for each seed, on the real pool every
choice of two and of three of its five pairs, which belong to as many data sets. Both ways see the same
evaluations. Each of these goes through a store, so that a run can be interrupted at any moment. Every pair is
cut to a window, so that ten runs for each number of pairs cost minutes. The real pool takes part where
SFKIT_REAL_DATA says where it lies.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path

import evidence_bank
import numpy as np
import pandas as pd
from evidence_bank import GENERATIONS, POPULATION, SHARP
from kept import RUNS, Job, KeptRuns
from real_pairs import PAIRS, opened
from stage2_worlds import BANK, BANK_WINDOW, REAL, REAL_WINDOW, Together, real_samples, store_in
from tabulated import markdown_lines

import sfkit
from sfkit.datasets import Benchmark
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.evaluation.known import Known
from sfkit.merging import Pool
from sfkit.search.averaging import averaged_winner
from sfkit.search.checks import RESAMPLES

STUDIES = {BANK: replace(SHARP, bank=BANK), SHARP.bank: SHARP}
"""Bank -> which pairs are drawn there, and which judge."""
BANK_PAIRS, SEEDS = (2, 5, 8, 16), 10
REAL_PAIRS = (2, 3)
EVALUATIONS = 40
"""Of the paper's Stage 2; the model's are by its defaults."""
BAYESIAN, PAPER = "bayesian", "paper"
BEST, AVERAGED, STAGE1 = "best on validation", "averaged winner", "Stage 1"

Stages = tuple[sfkit.SubsetSearch, sfkit.RoutingSearch]


def jobs() -> dict[str, Job]:
    """Name -> run: the first seed of everything first."""
    found: list[tuple[int, str, Job]] = []
    for method in (BAYESIAN, PAPER):
        for bank in STUDIES:
            for pairs in BANK_PAIRS:
                for seed in range(SEEDS):
                    name = f"{bank}-{method}-{pairs:02d}-{seed:02d}"
                    found.append((seed, name, partial(on_bank, bank, method, pairs, seed)))
        if "SFKIT_REAL_DATA" in os.environ:
            for pairs in REAL_PAIRS:
                for seed, guides in enumerate(combinations(PAIRS, pairs)):
                    name = f"{REAL}-{method}-{pairs:02d}-{seed:02d}"
                    found.append((seed, name, partial(on_real, method, guides, seed)))
    return {name: job for _, name, job in sorted(found, key=lambda one: one[0])}


def on_bank(bank: str, method: str, pairs: int, seed: int, folder: Path) -> pd.DataFrame:
    """Guided by windows of the validation world, judged on new ones of it and of three other worlds."""
    study = STUDIES[bank]
    judges = [one.benchmark for one in evidence_bank.unseen_evaluators(study).values()]
    guide = evidence_bank.drawn(study, pairs, seed)
    return compared(evidence_bank.opened(bank), bank, method, guide, judges, seed, folder)


def on_real(method: str, guides: Sequence[str], seed: int, folder: Path) -> pd.DataFrame:
    """Guided by pairs of some data sets, judged on those of the others."""
    judges = [of_pairs((name,)) for name in PAIRS if name not in guides]
    return compared(opened(), REAL, method, of_pairs(tuple(guides)), judges, seed, folder)


@lru_cache
def of_pairs(names: tuple[str, ...]) -> Benchmark:
    """Windows of real pairs as one benchmark, each alike."""
    windows = [real_samples()[name] for name in names]
    return memory_benchmark(f"windows-{'+'.join(names)}", windows, metric="bad-1.0")


def compared(
    pool: Pool,
    place: str,
    method: str,
    guide: Benchmark,
    judges: Sequence[Benchmark],
    seed: int,
    folder: Path,
) -> pd.DataFrame:
    """Both stages, and what each way returns of them: a row a network, Stage 1's as well.

    ``unseen`` is the mean over the benchmarks that judge, each alike; scores are in percent.
    """
    with store_in(folder) as store:
        evaluator = sfkit.Evaluator(pool, guide, store=store)
        first, second = stages(pool, Together(evaluator), method, seed)
        averaged = averaged_winner((first, second), evaluator, RESAMPLES, seed=seed)
        assert first.best is not None
        assert second.best is not None
        networks = {
            STAGE1: (first.best.recipe, first.best.score),
            BEST: (second.best.recipe, second.best.score),
            AVERAGED: (averaged.recipe, averaged.score),
        }
        recipes = [recipe for recipe, _ in networks.values()]
        judging = [Together(sfkit.Evaluator(pool, judge, store=store)) for judge in judges]
        unseen = np.mean([[outcome.score for outcome in judge(recipes)] for judge in judging], axis=0)
    return pd.DataFrame(
        {
            "place": place,
            "method": method,
            "pairs": len(guide),
            "seed": seed,
            "network": list(networks),
            "validation": [score for _, score in networks.values()],
            "unseen": unseen,
        }
    )


def stages(pool: Pool, scorer: Together, method: str, seed: int) -> Stages:
    """Both stages, run, by a model of the score or by the paper's searches."""
    first: sfkit.SubsetSearch
    if method == BAYESIAN:
        settings = sfkit.BayesianSubsetSettings(seed=seed)
        first = sfkit.BayesianSubsetSearch(pool.names, pool.blocks, scorer, settings)
        first.run()
        known = tuple(Known(c.recipe, c.score) for c in first.candidates if not c.repeated)
        assert first.best is not None
        second: sfkit.RoutingSearch = sfkit.BayesianRoutingSearch(
            first.best.subset,
            pool.blocks,
            scorer,
            sfkit.BayesianRoutingSettings(seed=seed),
            known=known,
        )
    else:
        budget = sfkit.SubsetSettings(population=POPULATION, generations=GENERATIONS, seed=seed)
        first = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, budget)
        routing = sfkit.RoutingSettings(evaluations=EVALUATIONS, seed=seed)
        second = sfkit.RoutingSearch(first.run().subset, pool.blocks, scorer, routing)
    second.run()
    return first, second


kept = KeptRuns(__doc__, jobs, RUNS / "returned")


BUDGET = f"M = {POPULATION}, T = {GENERATIONS} and {EVALUATIONS} evaluations of Stage 2"
TITLES = {
    BANK: f"On the first bank, bad-3.0, windows of {' x '.join(map(str, BANK_WINDOW))} px; "
    f"{SHARP.unseen} new windows of its world and of each of three other worlds judge",
    SHARP.bank: f"On `{SHARP.bank}`, the same",
    REAL: f"On the real AnyNet pool, bad-1.0, windows of {' x '.join(map(str, REAL_WINDOW))} px; every "
    "choice of two and of three of its five data sets guides, the others judge",
}
SEARCHED = {BAYESIAN: "by a model", PAPER: f"the paper's, {BUDGET}"}
HEAD = f"""## What to return: the best on validation, or the average of what wins resamples

`python benchmarks/returned.py` runs the searches and goes on where it was. Both stages are guided by a few
pairs, by a model of the score at its defaults. Of the same evaluations one way returns what scores lowest,
the other the average of what wins {RESAMPLES} resamples of the pairs, one evaluation more. Changes are
against Stage 1's equal weights of the same run, in points, at the mean over runs, **below 0 is better**;
unseen is the mean over what judges, the worst is that of one run. The last columns set the average beside the
best on what judges: mean difference with the standard error over runs, and in how many of the runs where they
differ it is better."""


def section() -> str:
    """Tables of whatever ``benchmarks/returned.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    frame = kept.results("")
    if frame.empty:
        raise SystemExit("nothing is finished yet: run python benchmarks/returned.py first")
    parts = [HEAD]
    for place, title in TITLES.items():
        found = frame[frame["place"] == place]
        if not found.empty:
            parts += [f"{title}:", table(found)]
    return "\n\n".join([*parts, together(frame)])


def changes(frame: pd.DataFrame) -> pd.DataFrame:
    """A row a run: the change against Stage 1 of both ways, on validation and on what judges."""
    keys = ["place", "method", "pairs", "seed"]
    wide = frame.pivot_table(index=keys, columns="network", values=["validation", "unseen"])
    found = {
        (kind, way): wide[kind][way] - wide[kind][STAGE1]
        for kind in ("validation", "unseen")
        for way in (BEST, AVERAGED)
    }
    return pd.DataFrame(found)


def table(found: pd.DataFrame) -> str:
    """A row a method and number of pairs, and one for all runs of a method."""
    rows = []
    for method, told in SEARCHED.items():
        of_method = found[found["method"] == method]
        if of_method.empty:
            continue
        every = changes(of_method)
        parts: Mapping[object, pd.DataFrame] = dict(iter(every.groupby("pairs")))
        rows += [(told, pairs, *cells(part)) for pairs, part in parts.items()]
        if len(parts) > 1:
            rows.append((told, "all", *cells(every)))
    heads = ("search", "pairs", "runs")
    for way in ("best", "average"):
        heads += (f"{way}: validation", "unseen", "worst")
    return markdown_lines((*heads, "average beside best", "better in"), rows)


def cells(part: pd.DataFrame) -> tuple[object, ...]:
    """Runs, changes of both ways, and the average beside the best."""
    told: list[object] = [len(part)]
    for way in (BEST, AVERAGED):
        unseen = part["unseen", way]
        told += [f"{value:+.2f}" for value in (part["validation", way].mean(), unseen.mean(), unseen.max())]
    return (*told, *beside(part))


def beside(part: pd.DataFrame) -> tuple[str, str]:
    """Mean difference on what judges with its standard error, and how often the average is better."""
    apart = part["unseen", AVERAGED] - part["unseen", BEST]
    error = apart.std(ddof=1) / np.sqrt(len(apart)) if len(apart) > 1 else np.nan
    return f"{apart.mean():+.2f} ± {error:.2f}", f"{(apart < 0.0).sum()} of {(apart != 0.0).sum()}"


def together(frame: pd.DataFrame) -> str:
    """All runs in one sentence."""
    every = changes(frame)
    mean, better = beside(every)
    worst = [f"{every['unseen', way].max():+.2f}" for way in (BEST, AVERAGED)]
    return (
        f"Over all {len(every)} runs the average is at {mean} points beside the best on what judges, better "
        f"in {better}; the worst run of the best is at {worst[0]} against Stage 1, that of the average at "
        f"{worst[1]}."
    )


if __name__ == "__main__":
    kept.main()
