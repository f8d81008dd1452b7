"""Does what Stage 2 gains on its validation pairs show elsewhere? Searches run and judged side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import RoutingCandidate, RoutingSettings

TRIAL = ("trial", "seed", "evaluations", "distance", "validation", "held", "equal")
"""Columns every table of trials starts with."""


@dataclass(frozen=True)
class Trial:
    """One way to run Stage 2, to be compared with others on the same pairs.

    Attributes:
        name: what the table calls it.
        settings: of the search; its seed is replaced by those of the comparison.
        shorten: t in (0, 1]: the vector found is shortened to t x, towards Stage 1, before it is judged;
            t < 1 is judged at the end of the search alone.
        partition: blocks in place of the pool's own; None for those.
    """

    name: str
    settings: RoutingSettings
    shorten: float = 1.0
    partition: BlockPartition | None = None


def run_trials(
    trials: Iterable[Trial],
    pool: Pool,
    subset: Sequence[str],
    scorer: Evaluator | CombinedScorer,
    judges: Mapping[str, Evaluator],
    *,
    seeds: Iterable[int] = (0,),
    marks: Iterable[int] = (),
) -> pd.DataFrame:
    """Run Stage 2 in several ways and score what each finds on benchmarks it never saw.

    Everything goes through the evaluation stores of ``scorer`` and ``judges``: run again, a comparison
    that was interrupted goes on where it was.

    Args:
        trials: the ways.
        pool: whose networks are merged.
        subset: Stage 1's sources, the same for all.
        scorer: the validation benchmark or benchmarks.
        judges: column name -> evaluator of an unseen benchmark.
        seeds: each trial is run once with each.
        marks: numbers of evaluations after which the best so far is judged as well.

    Returns:
        One row a (trial, seed, mark), and one for the end of each search: ``trial``, ``seed``,
        ``evaluations`` (spent so far), ``distance`` (mean square of the vector, 0 at x = 0),
        ``validation`` (score on all validation pairs), ``held`` (on those held out; NaN without),
        ``equal`` (x = 0 on all validation pairs), then for each judge its score of the recipe and, as
        ``NAME:equal``, that of x = 0.
    """
    rows = []
    for trial in trials:
        parted = pool if trial.partition is None else pool.with_blocks(trial.partition)
        guide = scorer.with_pool(parted)
        judging = {name: judge.with_pool(parted) for name, judge in judges.items()}
        for seed in seeds:
            settings = replace(trial.settings, seed=seed)
            search = RoutingSearch(parted.subset(subset), parted.blocks, guide, settings)
            search.run()
            rows += _judged(trial, seed, search, judging, marks)
    return pd.DataFrame(rows, columns=[*TRIAL, *(f"{n}{end}" for n in judges for end in ("", ":equal"))])


def _judged(
    trial: Trial,
    seed: int,
    search: RoutingSearch,
    judges: Mapping[str, Evaluator],
    marks: Iterable[int],
) -> list[dict[str, object]]:
    equal = search.candidates[0]
    spent = len(search.candidates)
    points = {mark: _best(search.candidates[:mark]) for mark in marks if mark < spent and trial.shorten == 1}
    best = search.best
    if best is None:
        raise InputError(f"trial {trial.name!r}: found no finite score, expected at least that of x = 0")
    points[spent] = best
    found = []
    for evaluations, candidate in points.items():
        x = np.array(candidate.x) * trial.shorten
        whole = trial.shorten == 1
        row = {
            "trial": trial.name,
            "seed": seed,
            "evaluations": evaluations,
            "distance": search.encoding.distance(x),
            "validation": candidate.score if whole else math.nan,
            "held": candidate.held if whole and candidate.held is not None else math.nan,
            "equal": equal.score,
        }
        recipe = candidate.recipe if whole else search.encoding.decode(x)
        found.append(row | _scores(recipe, equal.recipe, judges))
    return found


def _best(candidates: Sequence[RoutingCandidate]) -> RoutingCandidate:
    return min(candidates, key=lambda candidate: candidate.rank)


def _scores(recipe: Recipe, equal: Recipe, judges: Mapping[str, Evaluator]) -> dict[str, float]:
    scores: dict[str, float] = {}
    for name, judge in judges.items():
        ours, theirs = judge([recipe, equal])
        scores |= {name: ours.score, f"{name}:equal": theirs.score}
    return scores


def with_changes(table: pd.DataFrame, judges: Sequence[str]) -> pd.DataFrame:
    """The table with ``change`` on all validation pairs, and ``unseen``, the mean change over judges."""
    after = table[list(judges)].mean(axis=1, skipna=False)
    before = table[[f"{judge}:equal" for judge in judges]].mean(axis=1, skipna=False)
    return table.assign(change=table["validation"] - table["equal"], unseen=after - before)
