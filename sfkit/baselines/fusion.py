"""How merging strategies differ: what each selects, how it weighs, at what granularity (Table I)."""

from __future__ import annotations

import pandas as pd

from sfkit.baselines.registry import baseline_named, baselines

STRATEGIES: dict[str, tuple[str, str, str]] = {
    "single_best": ("best one", "1", "global"),
    "single_best_oracle": ("best one, by the tests", "1", "global"),
    "uniform": ("all", "equal (1/N)", "global"),
    "task_arithmetic": ("all", "one lambda, tuned", "global"),
    "greedy_soup": ("greedy", "equal (1/k)", "global"),
    "greedy_soup_strict": ("greedy", "equal (1/k)", "global"),
    "ties": ("all", "one lambda, tuned", "parameter"),
    "dare": ("all", "one lambda, tuned", "parameter"),
    "dare_ties": ("all", "one lambda, tuned", "parameter"),
    "fisher": ("all", "Fisher information", "parameter"),
    "adamerging": ("all", "learned", "source"),
    "adamerging_blocks": ("all", "learned", "block"),
    "random_subsets": ("random", "equal (1/k)", "global"),
    "exhaustive": ("all subsets tried", "equal (1/k)", "global"),
    "stage1": ("genetic algorithm", "equal (1/k)", "global"),
    "stage1_2": ("genetic algorithm", "CMA-ES", "block"),
    "averaged": ("genetic algorithm", "mean of bootstrap winners", "block"),
}
"""Method -> selection, weights, granularity; methods that others register are not known here."""


def fusion_table() -> pd.DataFrame:
    """One row a method: how it selects sources and weighs them, and how finely; all end as one network."""
    rows = {baseline_named(name).label: STRATEGIES.get(name, ("not stated",) * 3) for name in baselines()}
    columns = ["selection", "weights", "granularity"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("method")
