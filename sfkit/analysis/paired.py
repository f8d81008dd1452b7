"""Is a difference more than noise? Differences of scores, each with its interval over images and seeds.

How an interval is computed and what it counts stands in :mod:`sfkit.analysis.intervals`.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sfkit.analysis.intervals import FEWEST_IMAGES, LEVEL, RunsOnImages, holm, paired_estimate
from sfkit.analysis.labels import Judgement, judge, points
from sfkit.analysis.measured import Measured
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError

Names = str | Sequence[str]
"""One network, or several whose scores are averaged, such as a method's runs from several seeds."""


@dataclass(frozen=True)
class Difference:
    """How much a network's score differs from another's; negative is lower than the reference.

    Attributes:
        network: the network's name.
        reference: what it is compared with.
        benchmarks: over which benchmarks' mean.
        images: how many images each of these has; they are the unit of all intervals.
        unit: ``%`` (percentage points) or ``px``.
        value: score minus reference score; NaN where one of them failed.
        interval: lowest and highest of the confidence interval; None where none exists.
        level: the interval's coverage, such as 0.95.
        reason: why there is no interval; empty where there is one.
        p: p-value of no difference, corrected (Holm) where it is one of several; NaN without an interval.
        family: how many comparisons it was corrected with, itself among them.
        lower_is_better: of the metric.
        alone: ``p`` before any correction, as ``interval`` is.
    """

    network: str
    reference: str
    benchmarks: tuple[str, ...]
    images: tuple[int, ...]
    unit: str
    value: float
    interval: tuple[float, float] | None
    level: float = LEVEL
    reason: str = ""
    p: float = math.nan
    family: int = 1
    lower_is_better: bool = True
    alone: float = math.nan

    @property
    def within_noise(self) -> bool | None:
        """Whether no difference is shown, among all of its family; None where there is no interval."""
        if self.interval is None:
            return None
        if math.isnan(self.p):
            return self.interval[0] <= 0.0 <= self.interval[1]
        # The corrected p-value decides; the interval is that of one difference alone.
        return self.p >= 1.0 - self.level

    @property
    def word(self) -> Judgement:
        """Better, worse, within noise, or that there is no interval to tell by."""
        return judge(self.value, self.within_noise, lower_is_better=self.lower_is_better)

    @property
    def points(self) -> str:
        """The unit of the difference: a difference of percentages is in points."""
        return points(self.unit)

    @property
    def short(self) -> str:
        """For a column that names the reference, such as ``within noise, -0.1 [-0.4, 0.3] points``."""
        if self.interval is None:
            return f"{self.value:+.2f} {self.points}"
        low, high = self.interval
        return f"{self.word}, {self.value:+.2f} [{low:+.2f}, {high:+.2f}] {self.points}"

    @property
    def allowance(self) -> str:
        """Why an interval that leaves 0 out shows no difference: it is that of one, of many compared."""
        if not self.within_noise or self.interval is None:
            return ""
        return allowance(self.interval, self.family)

    @property
    def turned(self) -> Difference:
        """The same difference seen from the other side: the reference against the network."""
        turned = None if self.interval is None else (-self.interval[1], -self.interval[0])
        return replace(
            self, network=self.reference, reference=self.network, value=-self.value, interval=turned
        )

    def __str__(self) -> str:
        """A plain sentence, such as ``within noise of uniform: -0.1 [-0.4, 0.3] points``."""
        against = f"{self.value:+.2f} {self.points} against {self.reference}"
        if self.interval is None:
            return f"at {against}, no interval: {self.reason}"
        low, high = self.interval
        many = f" ({self.allowance})" if self.allowance else ""
        reach = f"{self.value:+.2f} [{low:+.2f}, {high:+.2f}] {self.points}"
        return f"{self.word.against} {self.reference}: {reach}{many}"


@dataclass(frozen=True)
class Spread:
    """One number found from several seeds.

    Attributes:
        values: one a seed, in order.
    """

    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise InputError("spread: found no value, expected one for each seed")

    @property
    def mean(self) -> float:
        """The mean; not finite where a run has no score."""
        return math.fsum(self.values) / len(self.values)

    @property
    def deviation(self) -> float:
        """The standard deviation between seeds (divided by n - 1); NaN for a single seed."""
        return statistics.stdev(self.values) if len(self.values) > 1 else math.nan

    def __str__(self) -> str:
        if len(self.values) == 1:
            return f"{self.mean:.2f} from one seed"
        low, high = min(self.values), max(self.values)
        count = len(self.values)
        return f"{self.mean:.2f} ± {self.deviation:.2f} over {count} seeds ({low:.2f} to {high:.2f})"


def paired_difference(
    measured: Measured | Sequence[Measured],
    network: Names,
    reference: Names,
    *,
    metric: str | None = None,
    level: float = LEVEL,
    named: tuple[str, str] | None = None,
) -> Difference:
    """A network against a reference on one benchmark or the mean of several, with its interval.

    Both are compared on the same images. A side of several runs is a method that draws at random: the
    spread of its runs belongs to the interval then. Under five images there is no interval.

    Args:
        measured: from :func:`~sfkit.analysis.measured.measure_recipes`; means weigh each benchmark alike.
        network: its name; or several whose scores are averaged, such as a method's seeds.
        reference: likewise.
        metric: each benchmark's own unless given.
        level: the interval's coverage.
        named: what to call both sides; needed where one is several networks.

    Raises:
        InputError: an unknown name or metric, metrics of different units, or no benchmark.
    """
    several = (measured,) if isinstance(measured, Measured) else tuple(measured)
    if not several or len({one.benchmark for one in several}) != len(several):
        listed = [one.benchmark for one in several]
        raise InputError(f"difference: found the benchmarks {listed}, expected at least one and each once")
    unit = common_unit(several, metric)
    sides = [_listed(network), _listed(reference)]
    one_side, other_side = named or (_named(network), _named(reference))
    benchmarks = tuple(one.benchmark for one in several)
    images = tuple(len(one.ids) for one in several)
    scores = [[[one.score(run, metric=metric) for run in side] for one in several] for side in sides]
    ours, theirs = (math.fsum(map(_mean, rows)) / len(rows) for rows in scores)
    # Two infinite scores are equal; their difference would be NaN.
    value = 0.0 if ours == theirs else ours - theirs
    lower = Metric.parse(metric or several[0].metric).lower_is_better
    found = Difference(
        one_side, other_side, benchmarks, images, unit, value, None, level, lower_is_better=lower
    )
    # The value stands: only whether it is noise cannot be told.
    if reason := _reason(several, scores):
        return replace(found, reason=reason)
    pairs = [tuple(runs_on_images(one, side, metric) for side in sides) for one in several]
    estimate = paired_estimate([(one, other) for one, other in pairs])
    return replace(found, interval=estimate.interval(level), p=estimate.p, alone=estimate.p)


def allowance(interval: tuple[float, float], family: int) -> str:
    """What is added to an interval where nothing is shown: why, if it leaves 0 out; else nothing.

    Args:
        interval: of one difference alone.
        family: among how many it was corrected.
    """
    return "" if interval[0] <= 0.0 <= interval[1] else f"one of {family} comparisons"


def corrected(differences: Sequence[Difference], beside: Sequence[float] = ()) -> tuple[Difference, ...]:
    """Differences of one table, so that all that are shown are wrong together at most once in 20 tables.

    See :func:`~sfkit.analysis.intervals.holm`; values and intervals stay what they are.

    Args:
        differences: corrected before or not; what counts is what each is alone.
        beside: uncorrected p-values of what is claimed beside the table and belongs to its family.
    """
    alone = [*(one.alone for one in differences), *beside]
    # Where there is no interval nothing is claimed, and nothing paid for.
    family = sum(not math.isnan(p) for p in alone)
    adjusted = holm(alone)[: len(differences)]
    return tuple(
        one if math.isnan(p) else replace(one, p=p, family=family)
        for one, p in zip(differences, adjusted, strict=True)
    )


def seed_spread(
    measured: Measured | Sequence[Measured], runs: Sequence[str], *, metric: str | None = None
) -> Spread:
    """The spread of the mean score over benchmarks between runs of one method from several seeds.

    Raises:
        InputError: no run, an unknown network, or metrics of different units.
    """
    several = (measured,) if isinstance(measured, Measured) else tuple(measured)
    common_unit(several, metric)
    scores = [[one.score(run, metric=metric) for one in several] for run in runs]
    return Spread(tuple(math.fsum(row) / len(row) for row in scores))


def common_unit(measured: Sequence[Measured], metric: str | None) -> str:
    """The unit in which scores of several benchmarks can be averaged.

    Raises:
        InputError: percent and pixels stand side by side, or no benchmark.
    """
    return one_unit([(one.benchmark, metric or one.metric) for one in measured])


def one_unit(metrics: Sequence[tuple[str, str]]) -> str:
    """The unit in which scores under these metrics, each with its benchmark's name, can be averaged.

    Raises:
        InputError: as :func:`common_unit`.
    """
    units = dict.fromkeys(Metric.parse(metric).unit for _, metric in metrics)
    if len(units) != 1:
        raise InputError(
            f"benchmarks {', '.join(name for name, _ in metrics)}: found metrics in "
            f"{' and '.join(units) or 'no unit'}, expected one unit for a mean: name one metric for all"
        )
    return next(iter(units))


def _reason(several: Sequence[Measured], scores: Sequence[Sequence[Sequence[float]]]) -> str:
    """Why there is no interval; empty where there is one."""
    for place, one in enumerate(several):
        values = [score for side in scores for score in side[place]]
        # NaN stands for a network that failed, infinity for a map that is not finite.
        if any(math.isnan(score) for score in values):
            return f"a network failed on {one.benchmark}"
        if not all(map(math.isfinite, values)):
            return f"a prediction on {one.benchmark} is not finite"
    for one in several:
        count = len(one.ids)
        if count < FEWEST_IMAGES:
            return f"{one.benchmark} has {count} image{'s' * (count != 1)}, an interval needs {FEWEST_IMAGES}"
    return ""


def runs_on_images(one: Measured, names: Sequence[str], metric: str | None = None) -> RunsOnImages:
    """The runs of one method on one benchmark, under its own metric unless given; none of them failed."""
    terms = [one.terms(name, metric=metric) for name in names]
    return RunsOnImages.of_terms(np.stack([above for above, _ in terms]), terms[0][1])


def _listed(names: Names) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _named(names: Names) -> str:
    return names if isinstance(names, str) else f"mean of {len(names)} runs"
