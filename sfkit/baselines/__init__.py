"""Baselines: every method the paper compares with, one function each, tuned on validation alone.

Each is called with a pool and an evaluator, and says what it chose, tried and cost::

    tuned = sfkit.baselines.task_arithmetic(pool, evaluator)
    run = sfkit.baselines.run_baselines(pool, evaluator, seed=1)
    sfkit.baselines.baseline_table(run)
"""

from sfkit.baselines.fusion import fusion_table
from sfkit.baselines.interference import dare, dare_ties, ties
from sfkit.baselines.learned import adamerging, adamerging_blocks, fisher
from sfkit.baselines.plain import single_best, single_best_oracle, task_arithmetic, uniform
from sfkit.baselines.registry import (
    Baseline,
    BaselineResult,
    Choice,
    Network,
    arrange,
    baseline,
    baseline_named,
    baselines,
    catalogue,
)
from sfkit.baselines.running import BaselineRun, baseline_table, run_baselines, score_baselines
from sfkit.baselines.soups import greedy_soup, greedy_soup_strict
from sfkit.baselines.subsets import averaged, exhaustive, random_subsets, stage1, stage1_2
from sfkit.baselines.trials import Trials

arrange(  # how tables list them
    single_best,
    single_best_oracle,
    uniform,
    task_arithmetic,
    greedy_soup,
    greedy_soup_strict,
    ties,
    dare,
    dare_ties,
    fisher,
    adamerging,
    adamerging_blocks,
    random_subsets,
    exhaustive,
    stage1,
    stage1_2,
    averaged,
)

__all__ = [
    "Baseline",
    "BaselineResult",
    "BaselineRun",
    "Choice",
    "Network",
    "Trials",
    "adamerging",
    "adamerging_blocks",
    "averaged",
    "baseline",
    "baseline_named",
    "baseline_table",
    "baselines",
    "catalogue",
    "dare",
    "dare_ties",
    "exhaustive",
    "fisher",
    "fusion_table",
    "greedy_soup",
    "greedy_soup_strict",
    "random_subsets",
    "run_baselines",
    "score_baselines",
    "single_best",
    "single_best_oracle",
    "stage1",
    "stage1_2",
    "task_arithmetic",
    "ties",
    "uniform",
]
