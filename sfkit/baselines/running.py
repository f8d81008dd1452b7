"""Several baselines in one call, and their tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from sfkit.baselines.registry import Baseline, BaselineResult, baseline_named, baselines
from sfkit.baselines.trials import Validation
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.table import ProgressCallback, score_table
from sfkit.merging.pool import Pool


@dataclass(frozen=True)
class BaselineRun:
    """What several baselines found.

    Attributes:
        results: by method name, in the order they were asked for.
        skipped: method name -> why it does not suit this pool or benchmark, one sentence.
    """

    results: Mapping[str, BaselineResult]
    skipped: Mapping[str, str]


def run_baselines(
    pool: Pool,
    validation: Validation,
    names: Iterable[str] | None = None,
    *,
    seed: int = 0,
    population: int = 50,
    generations: int = 15,
    evaluations: int = 300,
    tests: Sequence[Evaluator] = (),
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    progress: ProgressCallback = lambda *_: None,
) -> BaselineRun:
    """Run baselines one after the other on one validation benchmark.

    Args:
        pool: base and sources.
        validation: the evaluator every method tunes on; with a store, nothing is scored twice.
        names: which methods; None for all but those that run on request only. A method that does not suit
            is skipped with its reason, unless it was named.
        seed: of every method that draws.
        population: of Stage 1.
        generations: of Stage 1.
        evaluations: of Stage 2.
        tests: evaluators of the benchmarks one reports on; only the methods marked as oracles see them.
        settings: method name -> settings of its own.
        progress: told of each method when it begins, and of the end.

    Raises:
        InputError: an unknown method or setting, or a named method does not suit.
    """
    chosen = [baseline_named(name) for name in (baselines() if names is None else names)]
    chosen = [entry for entry in chosen if names is not None or not entry.on_request]
    own = settings or {}
    # A method nobody asked for may have settings; one that does not exist may not.
    for name in own:
        baseline_named(name)
    shared = {"seed": seed, "population": population, "generations": generations, "tests": tuple(tests)}
    shared["evaluations"] = evaluations
    results: dict[str, BaselineResult] = {}
    skipped: dict[str, str] = {}
    # Stage 1 first: random subsets get as many evaluations as it took.
    for done, entry in enumerate(sorted(chosen, key=lambda entry: entry.name != "stage1")):
        progress(entry.label, done, len(chosen))
        if "stage1" in results:
            shared["budget"] = results["stage1"].evaluations
        given = _settings(entry, shared, own.get(entry.name, {}))
        try:
            results[entry.name] = entry(pool, validation, **given)
        except InputError as error:
            # Who names a method wants to know why it cannot run; of all methods the others go on.
            if names is not None:
                raise
            skipped[entry.name] = str(error)
    progress("", len(chosen), len(chosen))
    # In the order that was asked for, not that of running.
    ordered = {entry.name: results[entry.name] for entry in chosen if entry.name in results}
    return BaselineRun(ordered, skipped)


def baseline_table(run: BaselineRun) -> pd.DataFrame:
    """One row a method: its score on validation, what it chose, what it cost, what it was allowed to see."""
    rows = [
        {
            "method": result.label,
            "validation": result.score,
            "chosen": ", ".join(f"{key}={_text(value)}" for key, value in result.settings.items()),
            "evaluations": result.evaluations,
            "image passes": result.image_passes,
            "wall seconds": result.seconds,
            "CPU seconds": math.nan if result.cpu_seconds is None else result.cpu_seconds,
            "sees": "the report's benchmarks" if result.oracle else "validation",
            "note": result.note,
        }
        for result in run.results.values()
    ]
    return pd.DataFrame(rows).set_index("method")


def score_baselines(
    run: BaselineRun,
    evaluators: Sequence[Evaluator],
    *,
    metrics: Sequence[str] = (),
    validation: Sequence[str] = (),
) -> pd.DataFrame:
    """Score the methods' networks on benchmarks; the columns of :func:`sfkit.evaluation.table.score_table`.

    Args:
        run: what :func:`run_baselines` returned.
        evaluators: of the benchmarks; their pool is the one the baselines were run on.
        metrics: as there.
        validation: names of the benchmarks that guided the methods.
    """
    # One by one: prepared task vectors have a pool of their own.
    parts = [
        score_table(
            [evaluator.with_pool(result.pool) for evaluator in evaluators],
            {result.label: result.recipe},
            metrics=metrics,
            validation=validation,
        )
        for result in run.results.values()
    ]
    return pd.concat(parts, ignore_index=True)


def _settings(entry: Baseline[Any], shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    for key in own:
        ensure_known(f"setting of baseline {entry.name!r}", key, entry.parameters)
    return {key: value for key, value in shared.items() if key in entry.parameters} | dict(own)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "+".join(map(str, value)) if isinstance(value, tuple) else str(value)
