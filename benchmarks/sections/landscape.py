"""The sharp bank's table of all subsets: how hard it is, and what searches need there."""

from __future__ import annotations

import numpy as np
import pandas as pd
from exhaustive import SubsetScores, subset_scores, table_path
from landscapes import Landscape
from optimum import LANDSCAPES, compared, entries, measured

DOCUMENT = "benchmarks/README.md"
POOL = "bank-sharp"
SEARCHES = (
    "sfkit, a model of the score",
    "sfkit, the paper's settings",
    "sfkit, the same with truncation",
    "greedy soup",
    "random search",
)
MARGINS = (0.1, 0.5)  # points of bad-3.0


def section() -> str:
    """What the table says, and our searches on it; no network runs."""
    table = subset_scores(table_path(POOL))
    parts = [described(table)]
    for pairs in LANDSCAPES:
        land = Landscape(table, quick=pairs != LANDSCAPES[0])
        found = [measured(land, name, pairs, entries()[name].search, _seeds(name)) for name in SEARCHES]
        parts.append(f"On the first {pairs} validation pairs:\n\n{compared(pd.concat(found))}")
    return "\n\n".join(parts)


def _seeds(name: str) -> range:
    return range(entries()[name].seeds)


def described(table: SubsetScores) -> str:
    """Best, middle and worst of all subsets, and how alike both numbers of pairs rank them."""
    masks = [mask for mask in table.scores if mask.bit_count() >= 2]
    scores = np.array([table.scores[mask] for mask in masks])
    quick = np.array([table.quick[mask] for mask in masks])
    best = masks[int(scores.argmin())]
    alike = pd.Series(scores).corr(pd.Series(quick), method="spearman")
    single, name = min((table.scores[1 << i], name) for i, name in enumerate(table.names))
    together = table.scores[(1 << len(table.names)) - 1]
    near = ", ".join(f"{(scores <= scores.min() + margin).sum()} within {margin}" for margin in MARGINS)
    lost = scores[quick.argmin()] - scores.min()
    many, few = LANDSCAPES
    return f"""## Every subset of the sharp bank's sources

`python benchmarks/exhaustive.py --bank {POOL}` scored all {len(table.scores):,} of them on the first
{many} pairs of the validation world, bad-3.0 in percent. Of the {len(masks):,} of two or more the best is
{", ".join(table.members(best))} ({scores.min():.2f}),
the median has {np.median(scores):.2f}, the worst {scores.max():.2f}, all {len(table.names)} together
{together:.2f}; the best single source is {name} ({single:.2f}). {near} points of the best.
The first {few} pairs rank them with a correlation of {alike:.2f}, and the best subset there is {lost:.2f}
points worse on {many} pairs than the best on those.

Distinct evaluations until the best subset of the pairs that guide, as above for the first bank:"""
