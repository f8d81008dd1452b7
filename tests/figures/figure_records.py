"""Small records with failures in them, and every figure drawn from them: what the figure tests share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go

from sfkit import figures
from sfkit.analysis import (
    BlockProbes,
    ComparedNetwork,
    DataSimilarity,
    Difference,
    InterpolationCurve,
    Measured,
    NetworkComparison,
    RegionScores,
    SelectionStatistics,
    TaskVectorGeometry,
    TrainingCurve,
    compare_networks,
    selection_statistics,
)
from sfkit.analysis.costs import MethodCost, Overhead, StageCost, overhead
from sfkit.analysis.differences import AdvantagePanels, advantage_panels
from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.evolution import Evolution, Individual, PopulationHistory, summarise
from sfkit.analysis.growth import PopulationSizes
from sfkit.analysis.predictions import Predictions, calibration
from sfkit.analysis.ranking import Ranking, agreement
from sfkit.analysis.routings import RoutingTrace
from sfkit.analysis.scores import ScoreColumn, ScoreGrid
from sfkit.baselines import fusion_table
from sfkit.datasets.metric import Metric
from sfkit.evaluation.metrics import ImageErrors, RegionErrors
from sfkit.merging import Recipe

CANDIDATES = (
    Individual(0, ("a", "b"), 30.0),
    Individual(1, ("a", "c"), 20.0),
    Individual(2, ("b", "c"), math.inf),
    Individual(3, ("a", "b", "c"), 10.0),
)
POPULATIONS = ((0, 1, 2), (3, 1, 2))


def population() -> PopulationHistory:
    return summarise(("a", "b", "c"), CANDIDATES, POPULATIONS, metric="bad-1.0")


def evolved() -> Evolution:
    """The same search; Jaccard distances by hand: each of the first three pairs shares 1 of 3 sources, then
    the whole set shares 2 of 3 with either subset.
    """
    return Evolution(
        population(),
        CANDIDATES,
        ((1, 0, 2), (3, 1, 2)),
        sizes=((2, 2.0, 2), (2, 7 / 3, 3)),
        diversity=(2 / 3, (1 / 3 + 1 / 3 + 2 / 3) / 3),
        archive=(3, 1, 0),
    )


def trace(*, tied: bool = True, evaluations: int = 12) -> RoutingTrace:
    rng = np.random.default_rng(0)
    rows = rng.dirichlet(np.ones(3), size=(evaluations, 1 if tied else 2))
    weights = np.broadcast_to(rows, (evaluations, 2, 3)).copy()
    score = rng.uniform(10.0, 20.0, evaluations)
    score[[0, 4]] = math.inf
    return RoutingTrace(
        sources=("a", "b", "c"),
        blocks=("one", "two"),
        gamma=(0.25, 1.75),
        metric="epe",
        generation=np.arange(evaluations) // 4,
        score=score,
        penalised=score.copy(),
        weights=weights,
        scales=rng.uniform(0.25, 1.75, (evaluations, 2)),
        sigma=0.5 / (1 + np.arange(evaluations) // 4),
        axes=np.sort(rng.uniform(0.1, 0.5, (evaluations, 5))),
    )


def told() -> Predictions:
    """Six proposals: two measured as predicted, three apart by 1, 2 and 3 deviations, one that failed."""
    mean, sd = np.linspace(20.0, 15.0, 6), np.full(6, 0.5)
    score = mean + sd * [0.0, 1.0, -2.0, 0.0, 3.0, math.inf]
    best = np.array([math.inf, 20.0, 19.5, 17.0, 17.0, 17.0])
    return Predictions("bad-1.0", np.arange(3, 9), mean, sd, mean - 2.5 * sd, score, best, learned=2)


def grid() -> ScoreGrid:
    columns = (
        ScoreColumn("guide", "bad-1.0", "%", validation=True),
        ScoreColumn("test <b>", "bad-1.0", "%", validation=False),
        ScoreColumn("guide", "epe", "px", validation=True),
    )
    values = np.array([[40.0, 50.0, 3.0], [math.nan, 45.0, 2.0], [30.0, 48.0, math.nan]])
    return ScoreGrid(("base", "a", "merged"), columns, values)


def costs() -> tuple[StageCost, ...]:
    return StageCost("Stage 1", 7, 4, 29, 2, 3.5, 2.0), StageCost("Stage 2", 60, 0, 0, 0, 18.0, 0.0, 9.0, 0.0)


def beside_training() -> Overhead:
    taken = [MethodCost("uniform", 1, 8, 4.8), MethodCost("Stage 1+2", 61, 488, 406.6, cpu_seconds=150.0)]
    return overhead(taken, {"a": 4000.0, "b": 2401.7}, 9500.6, joint_cpu=2927.0)


def sizes() -> PopulationSizes:
    best = np.array([[12.0, 11.0], [10.5, 10.0], [10.0, 10.0]])
    distinct = np.array([[20, 24], [60, 70], [110, 120]])
    return PopulationSizes((4, 12, 30), (0, 1), 5, best, distinct, "bad-1.0", 10.0)


def comparison() -> NetworkComparison:
    """Rows that are better, worse, within noise, without an interval, and failed."""
    found = {
        "better": (-2.0, (-3.0, -1.0)),
        "<b>worse</b>": (1.5, (0.5, 2.0)),
        "alike": (0.1, (-0.4, 0.6)),
        "single image": (0.7, None),
        "failed": (math.nan, None),
    }
    rows = [ComparedNetwork("merged", (10.0,), math.nan, 10.0)]
    for name, (value, interval) in found.items():
        one = Difference(name, "merged", ("test",), (12,), "%", value, interval, reason="one image")
        rows.append(ComparedNetwork(name, (10.0 + value,), math.nan, 10.0 + value, unseen_difference=one))
    return NetworkComparison("merged", (), tuple(rows), "%")


def panels(height: int = 20, width: int = 40) -> DisparityPanels:
    """Truth 2 px with a hole in the left half; errors 0 in the right half but for one broken pixel."""
    truth = np.full((height, width), 2.0, np.float32)
    truth[:, : width // 2] = np.nan
    broken = np.full((height, width), 2.0, np.float32)
    broken[0, -1] = np.nan
    error = np.abs(broken - truth)
    error[0, -1] = np.inf
    names = {"fine": truth.copy(), "<i>broken</i>": broken}
    maps = tuple(
        NetworkMaps(name, np.nan_to_num(seen, nan=9.0), error, {"bad-1.0": 12.345, "epe": 0.5})
        for name, seen in names.items()
    )
    left = np.full((height, width, 3), 99, np.uint8)
    return DisparityPanels("world", "all-valid", "pair <0>", left, truth, maps, (1.0, 5.0), 1.0)


def versus() -> AdvantagePanels:
    """The broken network against the fine one."""
    return advantage_panels(panels(), "fine", "<i>broken</i>")


def compared() -> NetworkComparison:
    """The base, one better beyond noise, one within it, one that failed on the test."""
    spread = [10, 40, 25, 60, 30, 55, 20, 45, 35, 50, 15, 33]

    def counts(shift: int, wobble: int = 0) -> tuple[ImageErrors, ...]:
        bad = [b + shift + (wobble if n % 2 else -wobble) for n, b in enumerate(spread)]
        return tuple(
            ImageErrors(str(n), (3.0,), 0, {"all": RegionErrors(100, 0.0, (b,), b)})
            for n, b in enumerate(bad)
        )

    guide = {"base": counts(0), "better": counts(-5, 2), "same": counts(0, 9), "broken": counts(3)}
    test = {"base": counts(0), "better": counts(-2, 1), "same": counts(1, 5), "broken": ()}
    measured = [
        Measured("guide", "all-valid", "pairs", "bad-3.0", True, guide),
        Measured("test <b>", "all-valid", "pairs", "bad-3.0", False, test),
        Measured("other", "all-valid", "pairs", "bad-3.0", False, {n: e[:1] for n, e in test.items()}),
    ]
    return compare_networks(measured, "base")


def curves() -> tuple[InterpolationCurve, ...]:
    at = np.linspace(0.0, 1.0, 5)
    made = []
    for number, name in enumerate(("a", "<b>")):
        for benchmark in ("guide", "test"):
            scores = 20.0 + 8.0 * (at - 0.3 * (number + 1)) ** 2
            scores[2] = math.nan if (number, benchmark) == (1, "test") else scores[2]
            made.append(InterpolationCurve(name, benchmark, "bad-3.0", "%", benchmark == "guide", at, scores))
    return tuple(made)


def geometry() -> TaskVectorGeometry:
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(3, 3, 50)) + 0.3
    vectors[2, 2] = 0.0
    products = np.einsum("ben,bfn->bef", vectors, vectors)
    conflicts, pairs = np.array([0.5, 0.6, 0.2]), np.full((3, 3), 0.4)
    norms = np.linalg.norm(vectors, axis=2)
    sizes = np.array([50, 50, 50])
    names, blocks = ("a", "b", "c"), ("one", "two", "(outside)")
    return TaskVectorGeometry(names, blocks, sizes, norms, np.ones(3) * 40, products, sizes, conflicts, pairs)


def probes() -> BlockProbes:
    def one(value: float, interval: tuple[float, float] | None) -> Difference:
        return Difference("probe", "mean", ("world",), (12,), "%", value, interval)

    rows = (
        (one(-2.0, (-3.0, -1.0)), one(0.4, (-0.2, 1.0)), one(math.nan, None)),
        (one(1.5, (1.0, 2.0)), one(-0.3, (-0.9, 0.3)), one(0.2, (0.1, 0.3))),
    )
    return BlockProbes(("one", "two"), ("a", "b", "c"), "world", "bad-3.0", "%", False, 21.0, rows)


def selection() -> SelectionStatistics:
    blocks = ("one", "two")
    recipes = {
        "guide, seed 0": Recipe(("a", "b"), blocks, ((0.3, 0.7), (0.5, 0.5)), (1.0, 1.0)),
        "guide, seed 1": Recipe.equal(["b"], blocks),
        "other, seed 0": Recipe.equal(["a", "b", "c"], blocks),
    }
    groups = {run: run.partition(",")[0] for run in recipes}
    return selection_statistics(recipes, ("a", "b", "c", "d"), groups=groups)


def similarities() -> tuple[DataSimilarity, ...]:
    distances = np.array([[0.0, 2.0], [1.0, 0.5], [3.0, 1.0]])
    return tuple(
        DataSimilarity(cue, ("a", "b", "c"), ("guide", "test"), distances + n)
        for n, cue in enumerate(("feature", "rgb", "disparity"))
    )


def regions() -> RegionScores:
    values = np.array([[20.0, 15.0, 60.0], [18.0, 14.0, math.nan]])
    names = ("all", "visible", "textureless")
    return RegionScores(
        "world", "all-valid", "bad-3.0", ("base", "a"), names, np.array([100.0, 90.0, 12.0]), values
    )


def rankings() -> tuple[Ranking, ...]:
    """Eight networks on two benchmarks: ranked as labels do but for one swap, and the other way round."""
    names, truth = tuple("abcdefgh"), np.arange(10.0, 90.0, 10.0)
    census = {"here": np.array([21.0, 20, 22, 23, 24, 25, 26, 27]), "there": np.arange(8.0)[::-1]}
    return tuple(
        Ranking(
            *(name, Metric.parse("bad-1.0"), names, scores, truth),
            agreement(scores, truth, f"bad-1.0 on {name}"),
        )
        for name, scores in census.items()
    )


def trainings() -> tuple[TrainingCurve, ...]:
    """One that was scored on the way, and one that was not."""
    steps = np.arange(1.0, 5.0)
    losses = np.array([4.0, 2.0, 1.0, 1.0])
    curve = TrainingCurve(
        "a<b", steps, losses, np.array([4.0, 3.0, 7 / 3, 2.0]), steps * 1e-4, {2: 30.0, 4: 20.0}
    )
    return curve, replace(curve, name="c", scores={})


FIGURES: dict[str, Callable[[str], go.Figure]] = {
    "population": lambda theme: figures.population_figure(population(), theme=theme),
    "evolution": lambda theme: figures.evolution_figure(evolved(), theme=theme),
    "population sizes": lambda theme: figures.population_sizes_figure(sizes(), theme=theme),
    "comparison": lambda theme: figures.comparison_figure(comparison(), theme=theme),
    "comparison by benchmark": lambda theme: figures.benchmark_comparison_figure(compared(), theme=theme),
    "interpolation": lambda theme: figures.interpolation_figure(curves(), theme=theme),
    "training": lambda theme: figures.training_figure(trainings(), theme=theme),
    "geometry": lambda theme: figures.geometry_figure(geometry(), theme=theme),
    "probes": lambda theme: figures.probes_figure(probes(), theme=theme),
    "selection": lambda theme: figures.selection_figure(selection(), theme=theme),
    "similarity": lambda theme: figures.similarity_figure(similarities(), theme=theme),
    "regions": lambda theme: figures.scores_figure(regions().grid(), theme=theme),
    "ranking": lambda theme: figures.ranking_figure(rankings(), theme=theme),
    "routing": lambda theme: figures.routing_figure(trace(), theme=theme),
    "routing by block": lambda theme: figures.routing_figure(trace(tied=False), theme=theme),
    "scales": lambda theme: figures.scales_figure(trace(), theme=theme),
    "cmaes": lambda theme: figures.cmaes_figure(trace(), theme=theme),
    "trust region": lambda theme: figures.cmaes_figure(replace(trace(), by_model=True), theme=theme),
    "predictions": lambda theme: figures.predictions_figure(told(), theme=theme),
    "calibration": lambda theme: figures.calibration_figure(calibration(told()), theme=theme),
    "scores": lambda theme: figures.scores_figure(grid(), theme=theme),
    "cost": lambda theme: figures.cost_figure(costs(), theme=theme),
    "overhead": lambda theme: figures.overhead_figure(beside_training(), theme=theme),
    "strategies": lambda theme: figures.fusion_figure(fusion_table(), theme=theme),
    "advantage": lambda theme: figures.advantage_figure(versus(), theme=theme),
    "disparity": lambda theme: figures.disparity_figure(panels(), theme=theme),
}
