"""Analysis: numbers for people to look at, as frozen records made by functions."""

from sfkit.analysis.bootstrap import Difference, Resampling, Spread, paired_difference, seed_spread
from sfkit.analysis.comparisons import (
    ComparedColumn,
    ComparedNetwork,
    NetworkComparison,
    compare_networks,
)
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
from sfkit.analysis.measured import Measured, measure_recipes, measure_with
from sfkit.analysis.populations import PopulationHistory, population_history, watched_population
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.analysis.scores import ScoreGrid, contenders, score_grid

__all__ = [
    "Advantage",
    "AdvantagePanels",
    "ComparedColumn",
    "ComparedNetwork",
    "Comparison",
    "Difference",
    "DisparityPanels",
    "Measured",
    "NetworkComparison",
    "OutlierRegion",
    "PopulationHistory",
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
    "measure_recipes",
    "measure_with",
    "outlier_regions",
    "paired_difference",
    "population_history",
    "routing_trace",
    "score_grid",
    "seed_spread",
    "stage_costs",
    "watched_population",
    "watched_routing",
]
