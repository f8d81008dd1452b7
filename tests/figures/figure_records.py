"""Small records with failures in them, and every figure drawn from them: what the figure tests share."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import plotly.graph_objects as go

from sfkit import figures
from sfkit.analysis.bootstrap import Difference
from sfkit.analysis.comparisons import ComparedNetwork, NetworkComparison
from sfkit.analysis.costs import StageCost
from sfkit.analysis.differences import AdvantagePanels, advantage_panels
from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.growth import PopulationSizes
from sfkit.analysis.populations import Individual, PopulationHistory, summarise
from sfkit.analysis.routings import RoutingTrace
from sfkit.analysis.scores import ScoreColumn, ScoreGrid


def population() -> PopulationHistory:
    candidates = [
        Individual(0, ("a", "b"), 30.0),
        Individual(1, ("a", "c"), 20.0),
        Individual(2, ("b", "c"), math.inf),
        Individual(3, ("a", "b", "c"), 10.0),
    ]
    return summarise(("a", "b", "c"), candidates, [(0, 1, 2), (3, 1, 2)], metric="bad-1.0")


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


def grid() -> ScoreGrid:
    columns = (
        ScoreColumn("guide", "bad-1.0", "%", validation=True),
        ScoreColumn("test <b>", "bad-1.0", "%", validation=False),
        ScoreColumn("guide", "epe", "px", validation=True),
    )
    values = np.array([[40.0, 50.0, 3.0], [math.nan, 45.0, 2.0], [30.0, 48.0, math.nan]])
    return ScoreGrid(("base", "a", "merged"), columns, values)


def costs() -> tuple[StageCost, ...]:
    return StageCost("Stage 1", 7, 4, 29, 2, 3.5, 2.0), StageCost("Stage 2", 60, 0, 0, 0, 18.0, 0.0)


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


FIGURES: dict[str, Callable[[str], go.Figure]] = {
    "population": lambda theme: figures.population_figure(population(), theme=theme),
    "population sizes": lambda theme: figures.population_sizes_figure(sizes(), theme=theme),
    "comparison": lambda theme: figures.comparison_figure(comparison(), theme=theme),
    "routing": lambda theme: figures.routing_figure(trace(), theme=theme),
    "routing by block": lambda theme: figures.routing_figure(trace(tied=False), theme=theme),
    "scales": lambda theme: figures.scales_figure(trace(), theme=theme),
    "cmaes": lambda theme: figures.cmaes_figure(trace(), theme=theme),
    "scores": lambda theme: figures.scores_figure(grid(), theme=theme),
    "cost": lambda theme: figures.cost_figure(costs(), theme=theme),
    "advantage": lambda theme: figures.advantage_figure(versus(), theme=theme),
    "disparity": lambda theme: figures.disparity_figure(panels(), theme=theme),
}
