"""The main comparison: every method on one pool, tuned on validation, tested on what none of them saw."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from sfkit.analysis.comparisons import NetworkComparison, compare_networks
from sfkit.analysis.costs import MethodCost, overhead_table
from sfkit.analysis.experiment import Experiment
from sfkit.analysis.headed import MEAN, UNSEEN, with_means
from sfkit.analysis.judgement import Judgement
from sfkit.analysis.labels import points
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import Difference, corrected, paired_difference
from sfkit.analysis.selection import SelectionStatistics, selection_statistics
from sfkit.analysis.tables import source_table
from sfkit.analysis.verdict import Verdict, verdict
from sfkit.analysis.worth import method_costs
from sfkit.baselines import BaselineResult, BaselineRun, run_baselines
from sfkit.editing import SeenByHand
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

SEEDED = ("stage1", "stage1_2")
"""Methods that are run once a seed."""
BASE, UNIFORM = "base", "uniform"
ORACLE = "†"
"""Stands behind a row that chose by the benchmarks of the report."""

LineCallback = Callable[[str], None]
"""Hears what begins."""


@dataclass(frozen=True, eq=False)
class Study:
    """Every method's network, measured.

    Attributes:
        experiment: pool, benchmarks, budgets.
        seeds: of the methods that are run once a seed.
        run: all methods, with the first seed.
        runs: network name -> result: the methods by their label, or ``LABEL, seed N`` for seeded ones.
        measured: all networks on every benchmark, validation first: base, sources, then those of ``runs``.
        comparison: a row a method, seeds averaged, differences to :attr:`reference`.
        reference: the row that others are compared with.
        verdict: what to deploy, why, and how sure.
        by_hand: reported benchmarks whose scores a person saw while editing; they count as guided.
    """

    experiment: Experiment
    seeds: tuple[int, ...]
    run: BaselineRun
    runs: Mapping[str, BaselineResult]
    measured: tuple[Measured, ...]
    comparison: NetworkComparison
    reference: str
    verdict: Verdict
    by_hand: tuple[SeenByHand, ...] = ()

    @property
    def chosen(self) -> str:
        """The network the verdict recommends."""
        return self.verdict.recommended

    @property
    def result(self) -> BaselineResult:
        """The method's result that :attr:`chosen` is the network of."""
        return self.runs[self.chosen]

    @property
    def pictured(self) -> str:
        """The network that figures, probes and maps are of: :attr:`chosen`, if the pool as read can make it.

        A network of prepared task vectors has a pool of its own; then it is the stages' best on validation.
        """
        if self.result.pool is self.experiment.pool:
            return self.chosen
        own = [name for name, one in self.runs.items() if one.pool is self.experiment.pool and not one.oracle]
        return min(own, key=lambda name: self.runs[name].score)

    @property
    def seed(self) -> int:
        """The seed of :attr:`pictured`; of the best run of the two stages where its method has none."""
        seeded = [name for name, one in self.runs.items() if one.name in SEEDED]
        of = {name: self.seeds[place % len(self.seeds)] for place, name in enumerate(seeded)}
        best = min(seeded, key=lambda name: self.runs[name].score, default="")
        return of.get(self.pictured, of.get(best, self.seeds[0]))

    @property
    def unseen(self) -> tuple[Measured, ...]:
        """The benchmarks that guided nothing."""
        return tuple(one for one in self.measured if not one.validation)

    @property
    def metric(self) -> str | None:
        """The metric of the comparison; None where each benchmark is shown under its own."""
        metrics = {one.metric for one in self.measured}
        return metrics.pop() if len(metrics) == 1 else None

    def mean(self, network: str) -> float:
        """A network's mean score over the unseen benchmarks; over all where none is unseen."""
        return _mean(one.score(network) for one in self.unseen or self.measured)

    def differences(self, network: str, references: Sequence[str]) -> tuple[Difference, ...]:
        """One network against others on the unseen benchmarks' mean, corrected for how many they are."""
        tests = self.unseen or self.measured
        return corrected([paired_difference(tests, network, name) for name in references])

    def selection(self) -> SelectionStatistics:
        """Which sources the seeds of the two stages chose, and with what weight."""
        kept = {name: result for name, result in self.runs.items() if result.name in SEEDED}
        return selection_statistics(
            {name: result.recipe for name, result in kept.items()},
            self.experiment.pool.names,
            groups={name: result.label for name, result in kept.items()},
        )

    def table(self) -> pd.DataFrame:
        """The paper's main table: a row a method, a column a benchmark, the mean of all and of the unseen.

        ``*`` marks the columns that guided, ``†`` the rows that chose by the test.
        """
        shown = self.comparison.columns
        rows = [row.scores for row in self.comparison.rows]
        names = pd.Index([self._marked(row.network) for row in self.comparison.rows], name="method")
        table = pd.DataFrame(rows, index=names, columns=[one.benchmark for one in shown])
        labels = {one.benchmark: one.label for one in shown}
        return with_means(table, shown, [one.benchmark for one in self.unseen]).rename(columns=labels)

    def differences_table(self) -> pd.DataFrame:
        """A row a method: how it differs from the reference on the unseen mean, how sure, over which seeds.

        In points (or pixels) with the ends of the interval; NaN where there is none, and the words say why.
        """
        unit = points(self.comparison.unit)
        rows = []
        for row in self.comparison.rows:
            found = row.difference
            low, high = (found and found.interval) or (math.nan, math.nan)
            rows.append(
                {
                    "method": self._marked(row.network),
                    f"to {self.reference} ({unit})": found.value if found else math.nan,
                    f"low ({unit})": low,
                    f"high ({unit})": high,
                    f"seeds ± ({unit})": row.spread.deviation if row.spread else math.nan,
                    f"gap to validation ({unit})": row.gap,
                    "verdict": _word(found),
                }
            )
        return pd.DataFrame(rows).set_index("method")

    def _marked(self, label: str) -> str:
        oracles = {result.label for result in self.runs.values() if result.oracle}
        return f"{label} {ORACLE}" if label in oracles else label

    def scores(self) -> pd.DataFrame:
        """Base, sources and methods, seeds averaged, for :func:`~sfkit.analysis.scores.score_grid`."""
        groups: dict[str, list[str]] = {name: [name] for name in (BASE, *self.experiment.pool.names)}
        for name, result in self.runs.items():
            groups.setdefault(result.label, []).append(name)
        rows = [
            {
                "network": network,
                "benchmark": one.benchmark,
                "metric": one.metric,
                "unit": one.unit,
                "score": _mean(one.score(name) for name in names),
                "role": "validation" if one.validation else "reported",
            }
            for one in self.measured
            for network, names in groups.items()
        ]
        return pd.DataFrame(rows)

    def sources_table(self) -> pd.DataFrame:
        """The paper's table of sources: a row a benchmark, a column the base, each source, and uniform.

        Below stand the mean of all benchmarks, by which the oracle chooses, and that of the unseen.
        """
        names = (BASE, *self.experiment.pool.names, UNIFORM)
        shown = [replace(one, images={name: one.images[name] for name in names}) for one in self.measured]
        table = source_table(shown)
        columns = self.comparison.columns
        scores = table.T.set_axis([one.benchmark for one in columns], axis=1)
        means = with_means(scores, columns, [one.benchmark for one in self.unseen])[[MEAN, UNSEEN]]
        return pd.concat([table, means.T]).rename_axis("benchmark")

    def cost_table(self) -> pd.DataFrame:
        """What each method took: evaluations on validation, image pairs through a network, seconds.

        Each stands for itself: what two methods share is in both rows, and what the store saved is counted.
        """
        rows = [
            {
                "method": result.label,
                "evaluations": result.evaluations,
                "image passes": result.image_passes,
                "seconds": result.seconds,
                "chosen": ", ".join(f"{k} = {_shown(v)}" for k, v in result.settings.items()),
            }
            for result in self.run.results.values()
        ]
        return pd.DataFrame(rows).set_index("method")

    def costs(self) -> tuple[MethodCost, ...]:
        """What each method took, each for itself, for tables and figures."""
        return method_costs(self.run)

    def overhead_table(self, training: Mapping[str, float]) -> pd.DataFrame:
        """What each method took beside the fine-tuning of the sources: the paper's table of costs.

        Args:
            training: source -> seconds its fine-tuning took.

        Raises:
            InputError: no training, or one without a positive time.
        """
        return overhead_table(self.costs(), training)


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
        seeds: how many seeds the two stages are run with, from the experiment's on.
        methods: names as :func:`~sfkit.baselines.baselines` lists them; all usual ones unless given.
        reference: the method that others are compared with, by its name; the last one unless given.
        settings: method name -> settings of its own.
        progress: hears a line when a method begins.

    Raises:
        InputError: no seed, an unknown method, or a reference that was not run.
    """
    if seeds < 1:
        raise InputError(f"seeds: found {seeds}, expected at least 1")
    used = tuple(experiment.seed + number for number in range(seeds))
    tests = [experiment.scorer(one, experiment.metric_of(one)) for one in experiment.columns]
    run = _run(experiment, used[0], methods, tests, settings, progress)
    runs = _seeded(experiment, run, used, settings, progress)
    progress("every network on every benchmark")
    measured = experiment.measured(_networks(experiment.pool, runs))
    name = reference or list(run.results)[-1]
    if name not in run.results:
        raise InputError(f"reference: found {name!r}, expected one of: {', '.join(run.results)}")
    label = run.results[name].label
    comparison = _compare(experiment, measured, runs, label)
    found = _verdict(experiment, measured, runs)
    return Study(experiment, used, run, runs, measured, comparison, label, found, experiment.by_hand)


def _run(
    experiment: Experiment,
    seed: int,
    methods: Iterable[str] | None,
    tests: Sequence[Evaluator],
    settings: Mapping[str, Mapping[str, Any]] | None,
    progress: LineCallback,
) -> BaselineRun:
    def heard(label: str, done: int, total: int) -> None:
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
        progress=heard,
    )


def _seeded(
    experiment: Experiment,
    run: BaselineRun,
    seeds: Sequence[int],
    settings: Mapping[str, Mapping[str, Any]] | None,
    progress: LineCallback,
) -> dict[str, BaselineResult]:
    """Results by network name; the stages once a seed."""
    again = [name for name in SEEDED if name in run.results]
    others = {seed: _run(experiment, seed, again, (), settings, progress) for seed in seeds[1:] if again}
    runs: dict[str, BaselineResult] = {}
    for name, result in run.results.items():
        if name not in again:
            runs[result.label] = result
            continue
        for seed in seeds:
            found = result if seed == seeds[0] else others[seed].results[name]
            runs[f"{result.label}, seed {seed}"] = found
    return runs


def _networks(pool: Pool, runs: Mapping[str, BaselineResult]) -> dict[str, tuple[Pool, Recipe]]:
    """Base, sources, their equal mixture, and what methods found, each with the pool it belongs to."""
    alone = {name: (pool, pool.equal(name)) for name in pool.names}
    found = {name: (result.pool, result.recipe) for name, result in runs.items()}
    return {BASE: (pool, pool.base_recipe()), **alone, UNIFORM: (pool, pool.uniform()), **found}


def _compare(
    experiment: Experiment,
    measured: Sequence[Measured],
    runs: Mapping[str, BaselineResult],
    reference: str,
) -> NetworkComparison:
    """Base and methods; single sources have a table of their own."""
    groups: dict[str, list[str]] = {}
    for network, result in runs.items():
        if network != result.label:
            groups.setdefault(result.label, []).append(network)
    shown = (BASE, *runs)
    rows = [replace(one, images={name: one.images[name] for name in shown}) for one in measured]
    return compare_networks(rows, reference, seeds=groups)


def _verdict(
    experiment: Experiment, measured: Sequence[Measured], runs: Mapping[str, BaselineResult]
) -> Verdict:
    """Of all networks but oracles, which saw the tests; validation under the metric that guided."""
    able = {name: result for name, result in runs.items() if not result.oracle}
    guide = experiment.validation
    guides = [replace(one, metric=guide.metric) for one in measured if one.benchmark == guide.name]
    return verdict(
        {name: result.recipe for name, result in able.items()},
        guides,
        [one for one in measured if not one.validation],
        evaluations={name: result.evaluations for name, result in able.items()},
    )


def _word(found: Difference | None) -> str:
    if found is None:
        return "the reference"
    if found.word is Judgement.UNKNOWN:
        return f"{found.word}: {found.reason}"
    return str(found.word)


def _mean(values: Iterable[float]) -> float:
    listed = list(values)
    return math.fsum(listed) / len(listed) if listed else math.nan


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " + ".join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
