"""Analysis: numbers for people to look at, as frozen records made by functions."""

from sfkit.analysis.ablations import (
    fitness_metrics,
    over_seeds,
    stage_variants,
    subset_transfer,
    validation_sets,
)
from sfkit.analysis.bootstrap import Difference, Resampling, Spread, paired_difference, seed_spread
from sfkit.analysis.comparisons import ComparedColumn, ComparedNetwork, NetworkComparison, compare_networks
from sfkit.analysis.costs import StageCost, cost_table, stage_costs
from sfkit.analysis.differences import (
    Advantage,
    AdvantagePanels,
    OutlierRegion,
    advantage,
    advantage_panels,
    advantage_table,
    outlier_regions,
)
from sfkit.analysis.disparities import Comparison, DisparityPanels, disparity_panels
from sfkit.analysis.experiment import Answer, Experiment, overlap
from sfkit.analysis.export import export_table
from sfkit.analysis.growth import PopulationSizes, growth, population_sizes
from sfkit.analysis.measured import Measured, measure_recipes, measure_with
from sfkit.analysis.populations import PopulationHistory, population_history, watched_population
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.analysis.scores import ScoreGrid, contenders, score_grid

__all__ = [
    "Advantage",
    "AdvantagePanels",
    "Answer",
    "ComparedColumn",
    "ComparedNetwork",
    "Comparison",
    "Difference",
    "DisparityPanels",
    "Experiment",
    "Measured",
    "NetworkComparison",
    "OutlierRegion",
    "PopulationHistory",
    "PopulationSizes",
    "Resampling",
    "RoutingTrace",
    "ScoreGrid",
    "Spread",
    "StageCost",
    "advantage",
    "advantage_panels",
    "advantage_table",
    "compare_networks",
    "contenders",
    "cost_table",
    "disparity_panels",
    "export_table",
    "fitness_metrics",
    "growth",
    "measure_recipes",
    "measure_with",
    "outlier_regions",
    "over_seeds",
    "overlap",
    "paired_difference",
    "population_history",
    "population_sizes",
    "routing_trace",
    "score_grid",
    "seed_spread",
    "stage_costs",
    "stage_variants",
    "subset_transfer",
    "validation_sets",
    "watched_population",
    "watched_routing",
]
