"""Tables of scores: recipes in rows, benchmarks in columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.measure import Metric
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.store import EvaluationStore
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

COLUMNS = (
    "network",
    "benchmark",
    "protocol",
    "metric",
    "unit",
    "score",
    "role",
    "images",
    "flagged",
    "cached",
)


def score_recipes(
    pool: Pool,
    recipes: Mapping[str, Recipe],
    benchmarks: Sequence[Benchmark],
    *,
    metrics: Sequence[str] = (),
    validation: Sequence[str] = (),
    store: EvaluationStore | None = None,
    device: str = "cpu",
) -> pd.DataFrame:
    """Score named recipes on benchmarks, one row a (network, benchmark, metric).

    Args:
        pool: the recipes' pool.
        recipes: row name -> recipe.
        benchmarks: what to score on.
        metrics: the metrics of each benchmark; its own default where none is named.
        validation: names of benchmarks that guided a search; their rows have the role ``validation``.
        store: where evaluations are kept.
        device: as for :class:`~sfkit.evaluation.evaluator.Evaluator`.

    Returns:
        Columns ``COLUMNS``; ``score`` in percent or pixels (``unit``), NaN where a candidate failed;
        ``flagged`` counts images whose prediction was not finite.
    """
    rows = []
    for benchmark in benchmarks:
        wanted = [Metric.parse(m) for m in (metrics or (benchmark.metric,))]
        names = [metric.name for metric in wanted]
        evaluator = Evaluator(pool, benchmark, store=store, metric=names[0], also=names[1:], device=device)
        evaluations = evaluator.evaluate(list(recipes.values()))
        role = "validation" if benchmark.name in validation else "reported"
        for metric in wanted:
            for name, evaluation in zip(recipes, evaluations, strict=True):
                score = math.nan if evaluation.failure else evaluator.score(evaluation.images, metric)
                flagged = sum(image.flagged for image in evaluation.images)
                row = (name, benchmark.name, benchmark.protocol, metric.name, metric.unit, score, role)
                rows.append((*row, len(benchmark), flagged, evaluation.cached))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def pivot(scores: pd.DataFrame, *, mean: bool = True) -> pd.DataFrame:
    """The table people read: a row a network, a column a benchmark and metric, in the order first met.

    Validation columns bear a ``*``. With ``mean`` each metric gets the mean over the benchmarks that
    guided no search.
    """
    table = pd.DataFrame(index=pd.Index(dict.fromkeys(scores["network"]), name="network"))
    for (name, metric, role), part in scores.groupby(["benchmark", "metric", "role"], sort=False):
        mark = " *" if role == "validation" else ""
        unit = part["unit"].iloc[0]
        table[f"{name} {metric} [{unit}]{mark}"] = part.set_index("network")["score"]
    if mean:
        reported = scores[scores["role"] == "reported"]
        for (metric, unit), part in reported.groupby(["metric", "unit"], sort=False):
            if part["benchmark"].nunique() > 1:
                table[f"mean {metric} [{unit}]"] = part.groupby("network")["score"].mean()
    return table


def write_table(table: pd.DataFrame, path: Path) -> Path:
    """Write a table as CSV (RFC 4180), making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path)
    return path
