"""Selection statistics: how often searches choose a source, and with what weight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True, eq=False)
class SelectionStatistics:
    """R searches over N sources.

    Attributes:
        sources: N names, in the pool's order.
        runs: R names, such as ``courtyard, seed 0``.
        groups: R names of what the runs have in common, such as the validation set.
        weights: (R, N) mean over blocks of the routing weight; 0 where the source was not chosen.
        chosen: (R, N) True where the source is in the subset.
    """

    sources: tuple[str, ...]
    runs: tuple[str, ...]
    groups: tuple[str, ...]
    weights: NDArray[np.float64]
    chosen: NDArray[np.bool_]

    @property
    def frequency(self) -> NDArray[np.float64]:
        """(N,) share of the runs that chose each source."""
        return np.asarray(self.chosen.mean(axis=0))

    @property
    def weight_when_chosen(self) -> NDArray[np.float64]:
        """(N,) mean weight over the runs that chose a source; NaN where none did."""
        count = self.chosen.sum(axis=0)
        # NumPy computes both branches, also where nothing chose a source.
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(count > 0, np.where(self.chosen, self.weights, 0.0).sum(axis=0) / count, np.nan)

    @property
    def overlap(self) -> float:
        """Mean Jaccard index of two runs' subsets: 1 where all agree; NaN for a single run."""
        pairs = [
            float((self.chosen[a] & self.chosen[b]).sum() / (self.chosen[a] | self.chosen[b]).sum())
            for a in range(len(self.runs))
            # Each pair of runs once.
            for b in range(a)
        ]
        return float(np.mean(pairs)) if pairs else float("nan")

    def table(self) -> pd.DataFrame:
        """A row a source: share of runs by group and in all, mean weight where chosen, and over all."""
        groups = np.array(self.groups)
        table = pd.DataFrame(index=pd.Index(self.sources, name="source"))
        for group in dict.fromkeys(self.groups):
            table[f"chosen under {group} [%]"] = 100.0 * self.chosen[groups == group].mean(axis=0)
        table["chosen [%]"] = 100.0 * self.frequency
        table["weight when chosen"] = self.weight_when_chosen
        table["mean weight"] = self.weights.mean(axis=0)
        return table

    def rivals(self) -> pd.DataFrame:
        """A row a source: how often it is chosen and its mean weight, beside its strongest competitor's.

        The strongest of the others is the one chosen most often, by mean weight where two are (figure 5).
        """
        weights, frequency = self.weights.mean(axis=0), self.frequency
        rows = []
        for n, source in enumerate(self.sources):
            others = [m for m in range(len(self.sources)) if m != n]
            # Of two that are chosen alike often the heavier one.
            rival = max(others, key=lambda m: (frequency[m], weights[m]), default=None)
            rows.append(
                {
                    "source": source,
                    "chosen (%)": 100.0 * frequency[n],
                    "mean weight (%)": 100.0 * weights[n],
                    "strongest other": "" if rival is None else self.sources[rival],
                    "its chosen (%)": math.nan if rival is None else 100.0 * frequency[rival],
                    "its mean weight (%)": math.nan if rival is None else 100.0 * weights[rival],
                }
            )
        return pd.DataFrame(rows).set_index("source")


def selection_statistics(
    recipes: Mapping[str, Recipe], sources: Sequence[str], *, groups: Mapping[str, str] | None = None
) -> SelectionStatistics:
    """Count what searches chose.

    Args:
        recipes: run name -> the recipe it found.
        sources: all sources they could choose from, in the order to show.
        groups: run name -> what it belongs to, such as its validation set; one group unless given.

    Raises:
        InputError: no run, a run without a source or group, or a source that is not in the list.
    """
    if not recipes:
        raise InputError("selection: found no run, expected name -> recipe of at least one search")
    names = tuple(sources)
    weights = np.zeros((len(recipes), len(names)))
    chosen = np.zeros((len(recipes), len(names)), dtype=np.bool_)
    for row, (run, recipe) in enumerate(recipes.items()):
        if not recipe.sources or set(recipe.sources) - set(names):
            raise InputError(
                f"selection: run {run!r} chose {list(recipe.sources)}, expected some of {', '.join(names)}"
            )
        columns = [names.index(source) for source in recipe.sources]
        # Over blocks, whose rows are equal where they are tied.
        weights[row, columns] = np.mean(recipe.weights, axis=0)
        chosen[row, columns] = True
    if groups is not None and (missing := [run for run in recipes if run not in groups]):
        raise InputError(f"selection: found no group for the runs {missing}, expected one for each")
    belongs = tuple("all runs" if groups is None else groups[run] for run in recipes)
    return SelectionStatistics(names, tuple(recipes), belongs, weights, chosen)
