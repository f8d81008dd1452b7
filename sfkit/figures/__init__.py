"""Figures: plotly pictures of records that :mod:`sfkit.analysis` made; nothing is computed here.

Every function takes ``theme="light"``, ``"dark"`` or ``"auto"``: transparent backgrounds, and colours
that read on a light page, a dark one, or both.
"""

from sfkit.figures.comparisons import benchmark_comparison_figure, comparison_figure
from sfkit.figures.costs import cost_figure, method_cost_figure, overhead_figure
from sfkit.figures.differences import advantage_figure
from sfkit.figures.disparities import disparity_figure
from sfkit.figures.distributions import cmaes_figure
from sfkit.figures.evolution import evolution_figure, population_figure
from sfkit.figures.fusion import fusion_figure
from sfkit.figures.geometry import geometry_figure
from sfkit.figures.growth import population_sizes_figure
from sfkit.figures.interpolation import interpolation_figure
from sfkit.figures.predictions import calibration_figure, predictions_figure
from sfkit.figures.probes import probes_figure
from sfkit.figures.qualitative import qualitative_figure
from sfkit.figures.ranking import ranking_figure
from sfkit.figures.retraining import teaser_figure
from sfkit.figures.routings import routing_figure, scales_figure
from sfkit.figures.scores import scores_figure
from sfkit.figures.selection import rivals_figure, selection_figure
from sfkit.figures.similarity import similarity_figure
from sfkit.figures.theme import Theme, template
from sfkit.figures.training_curves import training_figure

__all__ = [
    "Theme",
    "advantage_figure",
    "benchmark_comparison_figure",
    "calibration_figure",
    "cmaes_figure",
    "comparison_figure",
    "cost_figure",
    "disparity_figure",
    "evolution_figure",
    "fusion_figure",
    "geometry_figure",
    "interpolation_figure",
    "method_cost_figure",
    "overhead_figure",
    "population_figure",
    "population_sizes_figure",
    "predictions_figure",
    "probes_figure",
    "qualitative_figure",
    "ranking_figure",
    "rivals_figure",
    "routing_figure",
    "scales_figure",
    "scores_figure",
    "selection_figure",
    "similarity_figure",
    "teaser_figure",
    "template",
    "training_figure",
]
