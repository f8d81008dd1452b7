"""Analysis: numbers for people to look at, as frozen records made by functions."""

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
from sfkit.analysis.populations import PopulationHistory, population_history, watched_population
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.analysis.scores import ScoreGrid, contenders, score_grid

__all__ = [
    "Advantage",
    "AdvantagePanels",
    "Comparison",
    "DisparityPanels",
    "OutlierRegion",
    "PopulationHistory",
    "RoutingTrace",
    "ScoreGrid",
    "StageCost",
    "advantage",
    "advantage_panels",
    "advantage_table",
    "contenders",
    "cost_table",
    "disparity_panels",
    "outlier_regions",
    "population_history",
    "routing_trace",
    "score_grid",
    "stage_costs",
    "watched_population",
    "watched_routing",
]
