"""Run the main comparison: every method, as often as it draws, and all their networks on every benchmark."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from sfkit.analysis.comparisons import NetworkComparison, compare_networks
from sfkit.analysis.experiment import Experiment
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import one_unit
from sfkit.analysis.study import AGAIN, AVERAGE, BASE, UNIFORM, LineCallback, Study, costs_of, with_draws
from sfkit.analysis.verdict import Verdict, prefer, verdict
from sfkit.baselines import BaselineResult, BaselineRun, run_baselines
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.search.averaging import check_averaging


def study(
    experiment: Experiment,
    *,
    seeds: int = 5,
    methods: Iterable[str] | None = None,
    reference: str | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    progress: LineCallback = lambda _line: None,
) -> Study:
    """Run every method, and measure all their networks on every benchmark.

    Args:
        experiment: pool, benchmarks, store and budgets.
        seeds: how often every method that draws is run: both stages and random subsets with so many seeds,
            from the experiment's on; DARE and DARE + TIES with so many draws.
        methods: names as :func:`~sfkit.baselines.baselines` lists them; all usual ones unless given. With
            the experiment's ``resamples`` the averaged winner comes last.
        reference: the method that others are compared with, by its name; that of the recommended network
            unless given.
        settings: method name -> settings of its own.
        progress: told a line when a method begins.

    Raises:
        InputError: no seed, an unknown method, a reference that was not run, ``resamples`` of one pair, or
            tests whose metrics have no common unit.
    """
    if seeds < 1:
        raise InputError(f"seeds: found {seeds}, expected at least 1")
    methods = None if methods is None else list(methods)
    averaged = [AVERAGE] if experiment.resamples else []
    # Before hours of search, and again when it is known what could run.
    _check_reference(reference, None if methods is None else dict.fromkeys([*methods, *averaged]))
    tested = [one for one in experiment.compared if not one.validation] or experiment.compared
    one_unit([(one.benchmark, one.metric) for one in tested])
    began, worked = time.perf_counter(), time.process_time()
    used = tuple(experiment.seed + number for number in range(seeds))
    tests = [experiment.scorer(one, experiment.metric_of(one)) for one in experiment.columns]
    settings = with_draws(settings or {}, seeds)
    if experiment.resamples:
        check_averaging(experiment.scorer())
        settings[AVERAGE] = {"resamples": experiment.resamples, **settings.get(AVERAGE, {})}
        # It comes last, when what its stages ask for is in the store.
        methods = None if methods is None else [name for name in methods if name != AVERAGE]
    run = _run(experiment, used[0], methods, tests, settings, progress)
    if experiment.resamples:
        last = _run(experiment, used[0], [AVERAGE], (), settings, progress)
        run = replace(run, results={**run.results, **last.results})
    runs = _seeded(experiment, run, used, settings, progress)
    progress("every network on every benchmark")
    measured = experiment.measured(_networks(experiment.pool, runs))
    _check_reference(reference, run.results)
    asked = None if reference is None else run.results[reference].label
    comparison, found = _judged(experiment, measured, runs, asked)
    label = comparison.reference
    took = time.perf_counter() - began, time.process_time() - worked
    by_hand = experiment.by_hand
    return Study(experiment, used, run, runs, measured, comparison, label, found, by_hand, took)


def _check_reference(reference: str | None, methods: Collection[str] | None) -> None:
    if reference is not None and methods is not None and reference not in methods:
        raise InputError(f"reference: found {reference!r}, expected one of: {', '.join(methods)}")


def _run(
    experiment: Experiment,
    seed: int,
    methods: Iterable[str] | None,
    tests: Sequence[Evaluator],
    settings: Mapping[str, Mapping[str, Any]] | None,
    progress: LineCallback,
) -> BaselineRun:
    def advance(label: str, done: int, total: int) -> None:
        if label:
            progress(f"method {done + 1} of {total}: {label}, seed {seed}")

    return run_baselines(
        experiment.pool,
        experiment.scorer(),
        methods,
        seed=seed,
        population=experiment.population,
        generations=experiment.generations,
        evaluations=experiment.evaluations,
        tests=tests,
        settings=settings,
        progress=advance,
    )


def _seeded(
    experiment: Experiment,
    run: BaselineRun,
    seeds: Sequence[int],
    settings: Mapping[str, Mapping[str, Any]] | None,
    progress: LineCallback,
) -> dict[str, BaselineResult]:
    """Results by network name: one a seed, or one a draw, of what draws."""
    again = [name for name in AGAIN if name in run.results]
    # The first seed ran together with all other methods.
    others = {seed: _run(experiment, seed, again, (), settings, progress) for seed in seeds[1:] if again}
    runs: dict[str, BaselineResult] = {}
    for name, result in run.results.items():
        if len(result.draws) > 1:
            for number, one in enumerate(result.draws):
                # A draw shares the history of its run, and so its cost.
                drawn = replace(result, pool=one.pool, recipe=one.recipe)
                runs[f"{result.label}, draw {number}"] = drawn
            continue
        if name not in again:
            runs[result.label] = result
            continue
        for seed in seeds:
            found = result if seed == seeds[0] else others[seed].results[name]
            runs[f"{result.label}, seed {seed}"] = found
    return runs


def _networks(pool: Pool, runs: Mapping[str, BaselineResult]) -> dict[str, tuple[Pool, Recipe]]:
    """Base, sources, their equal mixture, and what methods found, each with the pool it belongs to."""
    own = {name: (pool, recipe) for name, recipe in {**pool.alone(), UNIFORM: pool.uniform()}.items()}
    return own | {name: (result.pool, result.recipe) for name, result in runs.items()}


def _compare(
    experiment: Experiment,
    measured: Sequence[Measured],
    runs: Mapping[str, BaselineResult],
    reference: str,
) -> NetworkComparison:
    """Base and methods; single sources have a table of their own."""
    groups: dict[str, list[str]] = {}
    for network, result in runs.items():
        # Where there is a single run its name is the label.
        if network != result.label:
            groups.setdefault(result.label, []).append(network)
    shown = (BASE, *runs)
    rows = [replace(one, images={name: one.images[name] for name in shown}) for one in measured]
    return compare_networks(rows, reference, seeds=groups)


def _judged(
    experiment: Experiment,
    measured: Sequence[Measured],
    runs: Mapping[str, BaselineResult],
    reference: str | None,
) -> tuple[NetworkComparison, Verdict]:
    """The verdict, and every method beside ``reference`` or the recommended one; corrected together.

    Of all networks but oracles, which saw the tests; validation under the metric that guided.
    """
    able = {name: result for name, result in runs.items() if not result.oracle}
    recipes = {name: result.recipe for name, result in able.items()}
    guide = experiment.validation
    guides = [replace(one, metric=guide.metric) for one in measured if one.benchmark == guide.name]
    tests = [one for one in measured if not one.validation]
    spent = {cost.method: cost.evaluations for cost in costs_of(runs)}
    averages = [name for name, result in able.items() if result.name == AVERAGE]
    averaged = min(averages, key=lambda name: able[name].score, default=None)
    # Which method others stand beside must be known before any test is looked at: its p-values are among
    # those that the verdict is corrected with.
    label = reference or runs[prefer(recipes, guides, averaged)].label
    before: list[float] = []  # p-values of what was looked at beside a method that tests then overruled
    while True:
        comparison = _compare(experiment, measured, runs, label)
        found = verdict(
            recipes,
            guides,
            tests,
            evaluations={name: spent[result.label] for name, result in able.items()},
            averaged=averaged,
            beside=(*before, *comparison.p_values) if tests else (),
        )
        recommended = runs[found.recommended].label
        if reference is not None or recommended == label:
            return comparison.among((*found.p_values, *before)), found
        # Ends: among more comparisons fewer networks are shown to be better.
        before += comparison.p_values
        label = recommended
