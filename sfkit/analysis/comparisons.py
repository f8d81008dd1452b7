"""The table that keeps people honest: scores, the gap to unseen benchmarks, differences with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from sfkit.analysis.intervals import LEVEL
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import Difference, Spread, common_unit, corrected, paired_difference, seed_spread
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.separation import column_name


@dataclass(frozen=True)
class ComparedColumn:
    """One benchmark under one metric.

    Attributes:
        benchmark: its name.
        protocol: which pixels count.
        metric: such as ``bad-1.0``.
        unit: ``%`` or ``px``.
        validation: True where it guided a search, so that its scores are no test.
    """

    benchmark: str
    protocol: str
    metric: str
    unit: str
    validation: bool

    @property
    def label(self) -> str:
        """Its heading; ``*`` marks what guided a search."""
        return column_name(self.benchmark, self.protocol, self.metric, self.unit, guided=self.validation)


@dataclass(frozen=True)
class ComparedNetwork:
    """One row.

    Attributes:
        network: its name.
        scores: one a column; NaN where it failed. Means over runs where the row is several seeds.
        guided: mean over the columns that guided a search; NaN without any, and where they were measured
            without ground truth or in another unit than the others.
        unseen: mean over the others; NaN without any.
        differences: to the reference, one a column; empty for the reference itself.
        guided_difference: to the reference on the mean of the columns that guided; None without any.
        unseen_difference: to the reference on the mean of the others; None without any.
        spread: of ``unseen`` (of ``guided`` where nothing is unseen) between seeds; None for one run.
    """

    network: str
    scores: tuple[float, ...]
    guided: float
    unseen: float
    differences: tuple[Difference, ...] = ()
    guided_difference: Difference | None = None
    unseen_difference: Difference | None = None
    spread: Spread | None = None

    @property
    def gap(self) -> float:
        """How much worse the unseen benchmarks are than those that guided: unseen minus guided."""
        return self.unseen - self.guided

    @property
    def difference(self) -> Difference | None:
        """The difference that matters: on unseen benchmarks where there are any."""
        return self.unseen_difference or self.guided_difference

    @property
    def overfit(self) -> bool:
        """True where validation got better than the reference and the unseen benchmarks did not."""
        guided, unseen = self.guided_difference, self.unseen_difference
        if guided is None or unseen is None:
            return False
        # Not "not within_noise": None, where nothing tells, is no gain either.
        return guided.value < 0.0 and guided.within_noise is False and unseen.value >= 0.0

    @property
    def outdoes_on_unseen(self) -> bool:
        """True where the reference is better than this row on validation and not on unseen benchmarks."""
        guided, unseen = self.guided_difference, self.unseen_difference
        if guided is None or unseen is None:
            return False
        return guided.value > 0.0 and guided.within_noise is False and unseen.value <= 0.0

    @property
    def sentences(self) -> tuple[str, ...]:
        """What the row says in words; nothing for the reference."""
        lines = []
        if self.difference is not None:
            seen = "" if self.unseen_difference else " (on what guided the search, no test)"
            lines.append(f"{self.network} is {self.difference}{seen}.")
        if self.overfit:
            lines.append(
                f"{self.network} gained on what guided it ({self.guided_difference}) and not on unseen "
                f"benchmarks ({self.unseen_difference}): it fits the validation images."
            )
        if self.spread is not None:
            lines.append(f"{self.network}: {self.spread}.")
        return tuple(lines)


@dataclass(frozen=True)
class NetworkComparison:
    """Networks in rows, benchmarks in columns, each row against one reference.

    Attributes:
        reference: the row that differences are taken to.
        columns: benchmarks in order.
        rows: networks in order.
        unit: of the means.
    """

    reference: str
    columns: tuple[ComparedColumn, ...]
    rows: tuple[ComparedNetwork, ...]
    unit: str

    def row(self, network: str) -> ComparedNetwork:
        """The row called ``network``.

        Raises:
            InputError: there is none.
        """
        for row in self.rows:
            if row.network == network:
                return row
        names = ", ".join(row.network for row in self.rows)
        raise InputError(f"comparison: found no row {network!r}, expected one of: {names}")

    @property
    def p_values(self) -> tuple[float, ...]:
        """Of the rows' differences that matter, each alone; NaN without an interval."""
        return tuple(row.difference.alone for row in self.rows if row.difference is not None)

    def among(self, beside: Sequence[float]) -> NetworkComparison:
        """The same rows, their differences on the unseen mean corrected with others that stand beside them.

        Args:
            beside: uncorrected p-values of these, such as :attr:`p_values` of another comparison.
        """
        return replace(self, rows=_corrected(self.rows, beside))

    @property
    def family(self) -> int:
        """Among how many comparisons the rows' words are corrected; 0 where no row has an interval."""
        found = [row.difference for row in self.rows if row.difference is not None]
        return max((one.family for one in found if one.interval is not None), default=0)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Every row in words, and where the reference gained on what guided it alone."""
        fits = [
            f"{self.reference} gained on what guided it against {row.network} ({-guided.value:+.2f} "
            f"{guided.points}) and not on unseen benchmarks ({-unseen.value:+.2f} {unseen.points}): "
            "it fits the validation images."
            for row in self.rows
            if row.outdoes_on_unseen
            and (guided := row.guided_difference) is not None
            and (unseen := row.unseen_difference) is not None
        ]
        return (*(sentence for row in self.rows for sentence in row.sentences), *fits)

    def table(self) -> pd.DataFrame:
        """A row a network: scores, means, the gap, the difference with its interval, the verdict.

        ``low`` and ``high`` are NaN where no interval exists; ``verdict`` says why.
        """
        unit = self.unit
        rows = []
        for row in self.rows:
            record: dict[str, object] = {"network": row.network}
            record |= {c.label: value for c, value in zip(self.columns, row.scores, strict=True)}
            record[f"mean of unseen [{unit}]"] = row.unseen
            record[f"gap to validation [{unit}]"] = row.gap
            # The reference has no difference, and few images give no interval.
            low, high = (row.difference and row.difference.interval) or (math.nan, math.nan)
            record[f"difference to {self.reference} [{unit}]"] = (
                row.difference.value if row.difference else math.nan
            )
            record |= {"low": low, "high": high}
            record["seeds ±"] = row.spread.deviation if row.spread else math.nan
            record["verdict"] = str(row.difference) if row.difference else "the reference"
            rows.append(record)
        return pd.DataFrame(rows).set_index("network")


def compare_networks(
    measured: Sequence[Measured],
    reference: str,
    *,
    seeds: Mapping[str, Sequence[str]] | None = None,
    metric: str | None = None,
    level: float = LEVEL,
) -> NetworkComparison:
    """Compare networks on benchmarks with a reference, each difference with its interval.

    What the table shows is corrected for how many differences it shows (Holm): those on the unseen mean
    together, those on the guiding mean, and those on single benchmarks.

    Args:
        measured: the benchmarks, from :func:`~sfkit.analysis.measured.measure_recipes`.
        reference: a row's name.
        seeds: row name -> the networks that are its runs from several seeds, shown as one row.
        metric: on every benchmark; each one's own unless given.
        level: coverage of the intervals.

    Raises:
        InputError: no benchmark, an unknown network, one in two rows, or metrics of different units.
    """
    rows = _rows(measured[0].networks, seeds or {})
    if reference not in rows:
        raise InputError(f"comparison: found no row {reference!r}, expected one of: {', '.join(rows)}")
    columns = tuple(_column(one, metric) for one in measured)
    # Of what tests: a guide without labels may be counted in another one.
    unit = common_unit([one for one in measured if not one.validation] or measured, metric)
    made = [_row(name, runs, reference, rows, measured, metric, level) for name, runs in rows.items()]
    return NetworkComparison(reference, columns, _corrected(made), unit)


def _corrected(rows: Sequence[ComparedNetwork], beside: Sequence[float] = ()) -> tuple[ComparedNetwork, ...]:
    """All rows, each family of their differences corrected together; ``beside`` belongs to the unseen's."""
    # Three families, one a question: Holm's price grows with the number of claims.
    single = iter(corrected([one for row in rows for one in row.differences]))
    guided = iter(corrected([row.guided_difference for row in rows if row.guided_difference]))
    unseen = iter(corrected([row.unseen_difference for row in rows if row.unseen_difference], beside))
    return tuple(
        replace(
            row,
            differences=tuple(next(single) for _ in row.differences),
            guided_difference=next(guided) if row.guided_difference else None,
            unseen_difference=next(unseen) if row.unseen_difference else None,
        )
        for row in rows
    )


def _rows(networks: Sequence[str], seeds: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    owner = {run: name for name, runs in seeds.items() for run in runs}
    # A run that two rows have is once in ``owner``; a row must not be called as a network outside of it.
    if len(owner) != sum(map(len, seeds.values())) or set(seeds) & (set(networks) - set(owner)):
        raise InputError("comparison: a network stands in two rows, expected each in one")
    if unknown := sorted(set(owner) - set(networks)):
        raise InputError(f"comparison: found the runs {unknown}, expected some of {', '.join(networks)}")
    rows: dict[str, tuple[str, ...]] = {}
    for network in networks:
        name = owner.get(network, network)
        rows[name] = tuple(seeds[name]) if network in owner else (network,)
    return rows


def _column(one: Measured, metric: str | None) -> ComparedColumn:
    parsed = Metric.parse(metric or one.metric)
    return ComparedColumn(one.benchmark, one.protocol, parsed.name, parsed.unit, one.validation)


def _row(
    name: str,
    runs: tuple[str, ...],
    reference: str,
    rows: Mapping[str, tuple[str, ...]],
    measured: Sequence[Measured],
    metric: str | None,
    level: float,
) -> ComparedNetwork:
    guides = [one for one in measured if one.validation]
    tests = [one for one in measured if not one.validation]
    # A single run has no spread.
    spread = seed_spread(tests or guides, runs, metric=metric) if len(runs) > 1 else None
    scores = tuple(mean_of(one.score(run, metric=metric) for run in runs) for one in measured)
    by_name = dict(zip((one.benchmark for one in measured), scores, strict=True))
    guided, unseen = (mean_of(by_name[one.benchmark] for one in group) for group in (guides, tests))
    if len({Metric.parse(metric or one.metric).kind for one in measured}) > 1:
        guided = math.nan  # a guide by census stands in no distance to errors
    if name == reference:
        return ComparedNetwork(name, scores, guided, unseen, spread=spread)

    def against(group: Sequence[Measured]) -> Difference:
        return paired_difference(
            group, runs, rows[reference], metric=metric, level=level, named=(name, reference)
        )

    differences = tuple(against([one]) for one in measured)
    on_guided, on_unseen = (against(group) if group else None for group in (guides, tests))
    return ComparedNetwork(name, scores, guided, unseen, differences, on_guided, on_unseen, spread)


def mean_of(values: Iterable[float]) -> float:
    """The mean; NaN of nothing."""
    listed = list(values)
    return math.fsum(listed) / len(listed) if listed else math.nan
