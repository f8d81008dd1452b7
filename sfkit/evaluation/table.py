"""Tables of scores: recipes in rows, benchmarks in columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from sfkit.datasets.benchmark import Benchmark
from sfkit.errors import InputError
from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.separation import column_name
from sfkit.evaluation.store import EvaluationStore
from sfkit.files import write_text
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
    "failure",
    "cached",
)

ProgressCallback = Callable[[str, int, int], None]
"""Called with a benchmark's name and how many of its evaluations are done, of how many."""


def score_recipes(
    pool: Pool,
    recipes: Mapping[str, Recipe],
    benchmarks: Sequence[Benchmark],
    *,
    metrics: Sequence[str] = (),
    validation: Sequence[str] = (),
    store: EvaluationStore | None = None,
    compute: Compute = HERE,
    progress: ProgressCallback | None = None,
) -> pd.DataFrame:
    """Score named recipes on benchmarks, one row a (network, benchmark, metric).

    All benchmarks are loaded and checked before the first evaluation.

    Args:
        pool: the recipes' pool.
        recipes: row name -> recipe.
        benchmarks: what to score on.
        metrics: the metrics of each benchmark; its own default where none is named, or none of them can be
            measured for want of ground truth.
        validation: names of benchmarks that guided a search; their rows have the role ``validation``.
        store: where evaluations are kept.
        compute: where and how networks run.
        progress: called for each evaluation when it is done.

    Returns:
        Columns ``COLUMNS``; ``score`` in percent or pixels (``unit``), NaN where a candidate failed and
        ``failure`` says why (None where it did not); ``flagged`` counts images whose prediction was not
        finite.

    Raises:
        InputError: a recipe does not suit the pool, a metric is unknown, or a benchmark cannot be scored.
    """
    for recipe in recipes.values():
        pool.check_recipe(recipe)
    _check_names([(b.name, b.protocol) for b in benchmarks])
    evaluators = [
        Evaluator(
            pool,
            benchmark,
            store=store,
            metric=next((one.name for one in benchmark.measurable(metrics)), None),
            also=metrics,
            compute=compute,
        )
        for benchmark in benchmarks
    ]
    return score_table(evaluators, recipes, metrics=metrics, validation=validation, progress=progress)


def score_table(
    evaluators: Sequence[Evaluator],
    recipes: Mapping[str, Recipe],
    *,
    metrics: Sequence[str] = (),
    validation: Sequence[str] = (),
    progress: ProgressCallback | None = None,
) -> pd.DataFrame:
    """As :func:`score_recipes`, with evaluators that are ready; ``metrics`` must be among theirs."""
    rows = []
    for evaluator in evaluators:
        benchmark = evaluator.benchmark
        role = "validation" if benchmark.name in validation else "reported"
        wanted = benchmark.measurable(metrics) or (evaluator.metric,)
        named = None if progress is None else partial(progress, benchmark.name)
        evaluations = evaluator.evaluate(list(recipes.values()), progress=named)
        evaluator.release()  # one network in memory at a time, however many benchmarks there are
        for metric in wanted:
            for name, evaluation in zip(recipes, evaluations, strict=True):
                score = math.nan if evaluation.failure else evaluator.score(evaluation.images, metric)
                flagged = sum(image.flagged for image in evaluation.images)
                row = (name, benchmark.name, benchmark.protocol, metric.name, metric.unit, score, role)
                rows.append((*row, len(benchmark), flagged, evaluation.failure, evaluation.cached))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    # Left to itself, pandas turns None into NaN as soon as one failure makes this a column of text.
    table["failure"] = pd.Series([row[COLUMNS.index("failure")] for row in rows], dtype=object)
    return table


def image_table(
    evaluators: Sequence[Evaluator],
    recipes: Mapping[str, Recipe],
    *,
    metrics: Sequence[str] = (),
) -> pd.DataFrame:
    """As :func:`score_table`, one row a (network, image, metric): each image's own error.

    Returns:
        Columns ``network``, ``benchmark``, ``image``, ``metric``, ``unit`` and ``score``; no row of a network
        that failed.
    """
    rows = []
    for evaluator in evaluators:
        benchmark = evaluator.benchmark
        wanted = benchmark.measurable(metrics) or (evaluator.metric,)
        evaluations = evaluator.evaluate(list(recipes.values()))
        # Workers of one benchmark end before the next one's start.
        evaluator.release()
        for name, evaluation in zip(recipes, evaluations, strict=True):
            for image in evaluation.images:
                for metric in wanted:
                    value = image.value(metric)
                    rows.append((name, benchmark.name, image.id, metric.name, metric.unit, value))
    return pd.DataFrame(rows, columns=["network", "benchmark", "image", "metric", "unit", "score"])


def pivot(scores: pd.DataFrame, *, mean: bool = True) -> pd.DataFrame:
    """The table people read: a row a network, a column a benchmark, protocol and metric, as first met.

    Validation columns bear a ``*``. With ``mean`` each metric that was reported on several benchmarks gets
    their mean; where some guided a search, the mean over all of them, as the paper has it, and last the mean
    over those that guided none. A network without a score on one of them has none.

    Raises:
        InputError: two benchmarks, or two networks, have one name.
    """
    rows = scores[["network", "metric", "benchmark", "protocol"]]
    twice = rows[rows.duplicated()]
    _check_names(2 * [(str(b), str(p)) for b, p in zip(twice["benchmark"], twice["protocol"], strict=True)])
    table = pd.DataFrame(index=pd.Index(dict.fromkeys(scores["network"]), name="network"))
    columns = ["benchmark", "protocol", "metric", "role"]
    for (name, protocol, metric, role), part in scores.groupby(columns, sort=False):
        names = (str(name), str(protocol), str(metric), str(part["unit"].iloc[0]))
        title = column_name(*names, guided=role == "validation")
        # By network, not by position: a benchmark may have been scored for some of them only.
        table[title] = part.set_index("network")["score"]
    if mean:
        guided = bool((scores["role"] == "validation").any())
        for (metric, unit), part in scores.groupby(["metric", "unit"], sort=False):
            reported = part[part["role"] == "reported"]
            # The mean of one benchmark is its column again.
            if reported["benchmark"].nunique() < 2:
                continue
            if len(reported) < len(part):
                table[f"mean of all {metric} [{unit}]"] = _means(part)
            table[f"mean {'of unseen ' if guided else ''}{metric} [{unit}]"] = _means(reported)
    return table


def _means(rows: pd.DataFrame) -> pd.Series:
    # Not skipping NaN: who failed somewhere, or was not scored there, has no mean to be praised for.
    place = ["benchmark", "protocol"]
    wide = rows.pivot_table(index="network", columns=place, values="score", dropna=False, observed=False)
    return wide.mean(axis=1, skipna=False)


def _check_names(names: Sequence[tuple[str, str]]) -> None:
    for name, protocol in names:
        if names.count((name, protocol)) > 1:
            raise InputError(
                f"benchmarks: found {name!r} under protocol {protocol!r} twice, expected a name each: give "
                "one another (dataclasses.replace(benchmark, name=...)), or rename its folder"
            )


def write_table(table: pd.DataFrame, path: Path) -> Path:
    """Write a table as CSV, its index only where that has a name; its folder is made."""
    return write_text(path, table.to_csv(index=table.index.name is not None))
