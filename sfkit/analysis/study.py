"""The main comparison: every method on one pool, tuned on validation, tested on what none of them saw."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from sfkit.analysis.comparisons import NetworkComparison, mean_of
from sfkit.analysis.costs import MethodCost, Overhead, or_unknown, overhead
from sfkit.analysis.experiment import Experiment
from sfkit.analysis.headed import MEAN, UNSEEN, with_means
from sfkit.analysis.labels import Judgement, points
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import Difference
from sfkit.analysis.selection import SelectionStatistics, selection_statistics
from sfkit.analysis.tables import source_table
from sfkit.analysis.verdict import Verdict
from sfkit.baselines import BaselineResult, BaselineRun
from sfkit.editing import SeenByHand
from sfkit.evaluation.outcome import total_known

AVERAGE = "averaged"
"""The method whose network the verdict prefers, where it was run."""
AGAIN = ("random_subsets", "stage1", "stage1_2", AVERAGE)
"""Methods that are run once a seed."""
DRAWING = ("dare", "dare_ties")
"""Methods that draw several networks in one run."""


def with_draws(settings: Mapping[str, Mapping[str, Any]], seeds: int) -> dict[str, Mapping[str, Any]]:
    """Settings by method: ``DRAWING`` draw as often as the stages have seeds, unless they say otherwise."""
    # What is set by hand comes last, so that it wins.
    drawing = {name: {"draws": seeds, **settings.get(name, {})} for name in DRAWING}
    return {**settings, **drawing}


def costs_of(runs: Mapping[str, BaselineResult]) -> tuple[MethodCost, ...]:
    """What each method took: its runs from several seeds summed, the draws of one run counted once.

    Args:
        runs: network name -> result; draws of one run share its history.
    """
    methods: dict[str, dict[int, BaselineResult]] = {}
    for result in runs.values():
        # Draws of one run share its history; runs with other seeds have one each.
        methods.setdefault(result.label, {})[id(result.history)] = result
    return tuple(
        MethodCost(
            label,
            sum(one.evaluations for one in found.values()),
            sum(one.image_passes for one in found.values()),
            math.fsum(one.seconds for one in found.values()),
            len(found),
            total_known(one.cpu_seconds for one in found.values()),
        )
        for label, found in methods.items()
    )


STAGES = ("stage1", "stage1_2")
"""The two stages, whose networks figures and probes look into."""
BASE, UNIFORM = "base", "uniform"
ORACLE = "†"
"""Stands behind a row that chose by the benchmarks of the report."""

LineCallback = Callable[[str], None]
"""Told what begins."""


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
        reference: the row that others are compared with: the recommended network's method unless asked
            for another.
        verdict: what to deploy, why, and how sure.
        by_hand: reported benchmarks whose scores a person saw while editing; they count as guided.
        took: wall and CPU seconds of making the study now, the CPU's of this process and its threads; what
            the store held took nothing. None where nobody measured.
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
    took: tuple[float, float] | None = None

    @property
    def computing(self) -> str:
        """What making it took now, wall seconds beside CPU seconds, as a sentence; empty if not measured."""
        if self.took is None:
            return ""
        wall, worked = self.took
        return (
            f"Methods and tests took {wall:,.1f} s of wall time now and {worked:,.1f} s of CPU time in this "
            "process; what the store held took nothing again, and counts below as when it was computed."
        )

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
        # By identity: a prepared pool has the same name and other task vectors.
        own = [name for name, one in self.runs.items() if one.pool is self.experiment.pool and not one.oracle]
        return min(own, key=lambda name: self.runs[name].score)

    @property
    def seed(self) -> int:
        """The seed of :attr:`pictured`; of the best run of the two stages where its method has none."""
        seeded = [name for name, one in self.runs.items() if one.name in (*STAGES, AVERAGE)]
        # Each method's runs stand in the order of the seeds, one method after the other.
        of = {name: self.seeds[place % len(self.seeds)] for place, name in enumerate(seeded)}
        staged = [name for name in seeded if self.runs[name].name in STAGES]
        best = min(staged, key=lambda name: self.runs[name].score, default="")
        return of.get(self.pictured, of.get(best, self.seeds[0]))

    @property
    def unseen(self) -> tuple[Measured, ...]:
        """The benchmarks that guided nothing."""
        return tuple(one for one in self.measured if not one.validation)

    @property
    def metric(self) -> str | None:
        """The metric of the unseen benchmarks; None where each is shown under its own."""
        metrics = {one.metric for one in self.unseen or self.measured}
        return metrics.pop() if len(metrics) == 1 else None

    def mean(self, network: str) -> float:
        """A network's mean score over the unseen benchmarks; over all where none is unseen."""
        return mean_of(one.score(network) for one in self.unseen or self.measured)

    def selection(self) -> SelectionStatistics:
        """Which sources the seeds of the two stages chose, and with what weight."""
        kept = {name: result for name, result in self.runs.items() if result.name in STAGES}
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

        The verdict is corrected for all comparisons on the unseen (:attr:`NetworkComparison.family`), those
        of the study's verdict among them; an interval is that of one difference alone.

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
        # Base and sources have one network each, methods one a seed.
        groups: dict[str, list[str]] = {name: [name] for name in (BASE, *self.experiment.pool.names)}
        for name, result in self.runs.items():
            groups.setdefault(result.label, []).append(name)
        rows = [
            {
                "network": network,
                "benchmark": one.benchmark,
                "metric": one.metric,
                "unit": one.unit,
                "score": mean_of(one.score(name) for name in names),
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
        """What each method took to choose among its runs: validation evaluations, image pairs, seconds.

        Runs from several seeds are summed, since all were needed to choose among them. Each method stands for
        itself: what two share is in both rows, and what the store saved is counted.
        """
        chosen = {
            result.label: ", ".join(f"{k} = {_shown(v)}" for k, v in result.settings.items())
            for result in self.run.results.values()
        }
        rows = [
            {
                "method": cost.method,
                "runs": cost.runs,
                "evaluations": cost.evaluations,
                "image passes": cost.image_passes,
                "wall seconds": cost.seconds,
                "CPU seconds": or_unknown(cost.cpu_seconds),
                "chosen": chosen[cost.method],
            }
            for cost in self.costs()
        ]
        return pd.DataFrame(rows).set_index("method")

    def costs(self) -> tuple[MethodCost, ...]:
        """What each method took, all its runs together, for tables and figures."""
        return costs_of(self.runs)

    def overhead(self, training: Mapping[str, float], joint: float | None = None, **cpu: Any) -> Overhead:
        """What each method took beside the fine-tuning of the sources, and beside joint retraining.

        Args and errors as :func:`~sfkit.analysis.costs.overhead`.
        """
        return overhead(self.costs(), training, joint, **cpu)

    def overhead_table(
        self, training: Mapping[str, float], joint: float | None = None, **cpu: Any
    ) -> pd.DataFrame:
        """The table of :meth:`overhead`: the paper's table of costs."""
        return self.overhead(training, joint, **cpu).table()


def _word(found: Difference | None) -> str:
    if found is None:
        return "the reference"
    if found.word is Judgement.UNKNOWN:
        return f"{found.word}: {found.reason}"
    return str(found.word)


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " + ".join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
