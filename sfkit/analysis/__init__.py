"""Analysis: numbers for people to look at, as frozen records made by functions."""

from sfkit.analysis.ablations import (
    fitness_criteria,
    fitness_metrics,
    selection_across,
    stage_variants,
    subset_transfer,
    validation_sets,
)
from sfkit.analysis.comparisons import ComparedColumn, ComparedNetwork, NetworkComparison, compare_networks
from sfkit.analysis.costs import (
    MethodCost,
    Overhead,
    StageCost,
    check_seconds,
    cost_table,
    overhead,
    overhead_table,
    stage_costs,
)
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
from sfkit.analysis.evolution import PopulationHistory, population_history
from sfkit.analysis.experiment import Answer, Experiment, overlap
from sfkit.analysis.features import BlockOutputs, block_modules
from sfkit.analysis.geometry import TaskVectorGeometry, task_vector_geometry
from sfkit.analysis.growth import PopulationSizes, growth, population_sizes
from sfkit.analysis.headed import ShownTable, publish_table, score_rows, shown_table
from sfkit.analysis.interpolation import InterpolationCurve, interpolated, interpolation_curves
from sfkit.analysis.linear_path import LinearPaths, linear_paths
from sfkit.analysis.measured import Measured, measure_recipes, measure_with
from sfkit.analysis.networks import measure_files, measure_networks
from sfkit.analysis.overfit import HoldoutCheck, holdout_check, holdout_sentence
from sfkit.analysis.paired import Difference, Spread, corrected, paired_difference, seed_spread
from sfkit.analysis.predictions import (
    PredictionCalibration,
    Predictions,
    calibration,
    predictions,
    watched_predictions,
)
from sfkit.analysis.probes import BlockProbes, block_probes, probe_recipes
from sfkit.analysis.provenance import environment
from sfkit.analysis.qualitative import qualitative_grid
from sfkit.analysis.ranking import Ranking, drawn_networks, rank_networks, ranking_table
from sfkit.analysis.references import reference_columns, reference_rows, with_references
from sfkit.analysis.regions import RegionScores, region_scores, textureless_mask
from sfkit.analysis.retraining import Retraining, open_joint, retraining_against_merging, study_against_joint
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.analysis.scores import ScoreGrid, contenders, score_grid
from sfkit.analysis.search_verdict import SearchVerdict, judges, search_verdict
from sfkit.analysis.selection import SelectionStatistics, selection_statistics
from sfkit.analysis.similarity import DataSimilarity, data_similarity, similarity_recipes
from sfkit.analysis.study import Study
from sfkit.analysis.studying import study
from sfkit.analysis.summary import summary
from sfkit.analysis.tables import (
    export_table,
    latex_table,
    ranks,
    recipe_table,
    shown,
    source_table,
)
from sfkit.analysis.training_curves import TrainingCurve, training_curve
from sfkit.analysis.trust import Trust, trust, trust_of, trust_sentences
from sfkit.analysis.verdict import Support, Verdict, simplicity, verdict
from sfkit.analysis.worth import compare_methods, method_costs, worth

Calibration = PredictionCalibration  # its former name, kept for one version

__all__ = [
    "Advantage",
    "AdvantagePanels",
    "Answer",
    "BlockOutputs",
    "BlockProbes",
    "Calibration",
    "ComparedColumn",
    "ComparedNetwork",
    "Comparison",
    "DataSimilarity",
    "Difference",
    "DisparityPanels",
    "Experiment",
    "HoldoutCheck",
    "InterpolationCurve",
    "LinearPaths",
    "Measured",
    "MethodCost",
    "NetworkComparison",
    "OutlierRegion",
    "Overhead",
    "PopulationHistory",
    "PopulationSizes",
    "PredictionCalibration",
    "Predictions",
    "Ranking",
    "RegionScores",
    "Retraining",
    "RoutingTrace",
    "ScoreGrid",
    "SearchVerdict",
    "SelectionStatistics",
    "ShownTable",
    "Spread",
    "StageCost",
    "Study",
    "Support",
    "TaskVectorGeometry",
    "TrainingCurve",
    "Trust",
    "Verdict",
    "advantage",
    "advantage_panels",
    "advantage_table",
    "block_modules",
    "block_probes",
    "calibration",
    "check_seconds",
    "compare_methods",
    "compare_networks",
    "contenders",
    "corrected",
    "cost_table",
    "data_similarity",
    "disparity_panels",
    "drawn_networks",
    "environment",
    "export_table",
    "fitness_criteria",
    "fitness_metrics",
    "growth",
    "holdout_check",
    "holdout_sentence",
    "interpolated",
    "interpolation_curves",
    "judges",
    "latex_table",
    "linear_paths",
    "measure_files",
    "measure_networks",
    "measure_recipes",
    "measure_with",
    "method_costs",
    "open_joint",
    "outlier_regions",
    "overhead",
    "overhead_table",
    "overlap",
    "paired_difference",
    "population_history",
    "population_sizes",
    "predictions",
    "probe_recipes",
    "publish_table",
    "qualitative_grid",
    "rank_networks",
    "ranking_table",
    "ranks",
    "recipe_table",
    "reference_columns",
    "reference_rows",
    "region_scores",
    "retraining_against_merging",
    "routing_trace",
    "score_grid",
    "score_rows",
    "search_verdict",
    "seed_spread",
    "selection_across",
    "selection_statistics",
    "shown",
    "shown_table",
    "similarity_recipes",
    "simplicity",
    "source_table",
    "stage_costs",
    "stage_variants",
    "study",
    "study_against_joint",
    "subset_transfer",
    "summary",
    "task_vector_geometry",
    "textureless_mask",
    "training_curve",
    "trust",
    "trust_of",
    "trust_sentences",
    "validation_sets",
    "verdict",
    "watched_predictions",
    "watched_routing",
    "with_references",
    "worth",
]
