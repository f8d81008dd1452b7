"""What a larger population finds, and what a pool that gains a source can take over from before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.analysis.ablations import scored
from sfkit.analysis.experiment import Experiment
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.opening import open_pool
from sfkit.search.breeding import SubsetSettings
from sfkit.search.subset import SubsetSearch

SIZES = (4, 8, 12, 20, 30, 40, 50, 60)


@dataclass(frozen=True, eq=False)
class PopulationSizes:
    """Stage 1 with populations of K sizes, S seeds each (figure "Population-size ablation").

    Attributes:
        sizes: K values of M.
        seeds: the S seeds.
        generations: T_1 of all.
        best: (K, S) validation score of the best subset found, lower is better.
        distinct: (K, S) subsets that had to be scored for it.
        metric: of the scores.
        optimum: the best score of all subsets, None where nobody has scored them all.
    """

    sizes: tuple[int, ...]
    seeds: tuple[int, ...]
    generations: int
    best: NDArray[np.float64]
    distinct: NDArray[np.int64]
    metric: str | None = None
    optimum: float | None = None

    def table(self) -> pd.DataFrame:
        """A row a size: mean, lowest and highest of the best scores, mean number of subsets scored."""
        return pd.DataFrame(
            {
                "mean best": self.best.mean(axis=1),
                "lowest": self.best.min(axis=1),
                "highest": self.best.max(axis=1),
                "subsets scored": self.distinct.mean(axis=1),
            },
            index=pd.Index(self.sizes, name="population"),
        )


def population_sizes(
    sources: Sequence[str],
    blocks: Sequence[str],
    scorer: Scorer,
    *,
    sizes: Sequence[int] = SIZES,
    seeds: Sequence[int] = (0, 1, 2, 3, 4),
    generations: int = 15,
    metric: str | None = None,
    optimum: float | None = None,
) -> PopulationSizes:
    """Run Stage 1 once a size and seed, on one scorer; a table of all subsets makes it cost nothing.

    Raises:
        InputError: no size or no seed.
    """
    if not sizes or not seeds:
        raise InputError(
            f"population sizes: found {len(sizes)} sizes and {len(seeds)} seeds, expected at least one each"
        )
    best = np.empty((len(sizes), len(seeds)))
    distinct = np.empty((len(sizes), len(seeds)), np.int64)
    for k, size in enumerate(sizes):
        for s, seed in enumerate(seeds):
            settings = SubsetSettings(population=size, generations=generations, seed=seed)
            search = SubsetSearch(sources, blocks, scorer, settings)
            best[k, s] = search.run().score
            distinct[k, s] = search.counts.distinct
    return PopulationSizes(tuple(sizes), tuple(seeds), generations, best, distinct, metric, optimum)


def growth(experiment: Experiment, newcomer: str) -> pd.DataFrame:
    """A pool gains a source: what does the search before it save the search after?

    Stage 1 runs without ``newcomer``, then with it: once from chance, and once from the best subsets of
    before, which take half of the first population. A subset scored before is in the store.

    Args:
        experiment: the grown pool, its benchmarks, the store and the budgets.
        newcomer: the source that the pool gains.

    Returns:
        A row a search: subsets it scored, how many of them were known from before, their share and the
        share of the evaluation time they saved (0 to 1), whether the newcomer takes part, its validation
        score, the benchmarks and their mean.

    Raises:
        InputError: no such source, or a pool that would be left with fewer than two.
    """
    pool = experiment.pool
    ensure_known("source of the pool", newcomer, pool.names)
    rest = tuple(member for member in pool.spec.sources if member.name != newcomer)
    smaller = experiment.changed(pool=open_pool(replace(pool.spec, sources=rest)))
    before = smaller.stage1()
    # The other half of the first population is drawn by chance, as ever.
    archive = [candidate.subset for candidate in before.archive(experiment.population // 2)]
    searches = {
        f"before, {len(rest)} sources": before,
        f"{len(pool.names)} sources, from chance": experiment.stage1(),
        f"{len(pool.names)} sources, from the best of before": experiment.stage1(start=archive),
    }
    known = {candidate.subset for candidate in before.candidates}
    recipes = {name: search.run().recipe for name, search in searches.items()}
    table = scored(experiment, recipes)
    for place, (column, values) in enumerate(_reuse(searches, known, before, newcomer).items()):
        table.insert(place, column, values)
    return table.rename_axis("search")


def _reuse(
    searches: dict[str, SubsetSearch],
    known: set[tuple[str, ...]],
    before: SubsetSearch,
    newcomer: str,
) -> dict[str, list[float]]:
    """Columns of :func:`growth`; a recipe's seconds are those of its first computation, stored with it."""
    columns: dict[str, list[float]] = {
        name: [] for name in ("scored", "known", "share known", "time saved", "newcomer", "validation")
    }
    for search in searches.values():
        asked = [c for c in search.candidates if not c.repeated]
        # The search before owes nothing to itself.
        held = [c for c in asked if search is not before and c.subset in known]
        total = sum(c.outcome.seconds for c in asked)
        best = search.best
        columns["scored"].append(len(asked))
        columns["known"].append(len(held))
        columns["share known"].append(len(held) / len(asked))
        columns["time saved"].append(sum(c.outcome.seconds for c in held) / total if total else 0.0)
        columns["newcomer"].append(best is not None and newcomer in best.subset)
        columns["validation"].append(float("nan") if best is None else best.score)
    return columns
