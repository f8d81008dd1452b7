"""Is a difference more than noise? Paired bootstrap over images (Efron and Tibshirani, 1993, chapter 16).

The unit is the image: pixels of one image err together, so that resampling them would find every
difference certain. Both networks are resampled on the same images, which takes away what makes an image
hard for both. Intervals say what other images of this kind would show, not what another search would
find; that is the spread over seeds (:class:`Spread`).
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.measured import Measured
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError

RESAMPLES = 2000
LEVEL = 0.95
FEW_IMAGES = 10
"""Below this many images a bootstrap interval is too narrow, and the record says so."""

Names = str | Sequence[str]
"""One network, or several whose scores are averaged, such as a method's runs from several seeds."""


@dataclass(frozen=True)
class Difference:
    """How much a network's score differs from another's; negative is better than the reference.

    Attributes:
        network: the network's name.
        reference: what it is compared with.
        benchmarks: over which benchmarks' mean.
        images: how many images each of these has; they are the unit that is resampled.
        unit: ``%`` (percentage points) or ``px``.
        value: score minus reference score; NaN where one of them failed.
        interval: lowest and highest of the confidence interval; None where none exists.
        level: the interval's coverage, such as 0.95.
        reason: why there is no interval; empty where there is one.
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

    @property
    def within_noise(self) -> bool | None:
        """Whether the interval holds 0; None where there is no interval."""
        return None if self.interval is None else self.interval[0] <= 0.0 <= self.interval[1]

    @property
    def few(self) -> bool:
        """True where so few images were resampled that the interval is likely too narrow."""
        return self.interval is not None and min(self.images) < FEW_IMAGES

    def __str__(self) -> str:
        """A plain sentence, such as ``within noise of uniform: -0.1 [-0.4, 0.3] %``."""
        if self.interval is None:
            return f"at {self.value:+.2f} {self.unit} against {self.reference}, no interval: {self.reason}"
        low, high = self.interval
        word = "within noise of" if self.within_noise else "better than" if high < 0.0 else "worse than"
        return f"{word} {self.reference}: {self.value:+.2f} [{low:+.2f}, {high:+.2f}] {self.unit}"


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


class Resampling:
    """Draws of images with replacement, the same for every network that is compared.

    Args:
        measured: the benchmarks; each is resampled within itself.
        rng: draws; the same generator state gives the same intervals.
        resamples: how many draws of each benchmark.
        level: coverage of intervals.

    Raises:
        InputError: no benchmark, one named twice, or a count or level out of range.
    """

    def __init__(
        self,
        measured: Sequence[Measured],
        rng: np.random.Generator,
        *,
        resamples: int = RESAMPLES,
        level: float = LEVEL,
    ) -> None:
        names = [one.benchmark for one in measured]
        if not measured or len(set(names)) != len(names):
            raise InputError(f"bootstrap: found the benchmarks {names}, expected at least one and each once")
        if resamples < 1 or not 0.0 < level < 1.0:
            raise InputError(
                f"bootstrap: found {resamples} resamples at level {level}, expected at least 1 and 0 to 1"
            )
        self.measured = {one.benchmark: one for one in measured}
        self.level = level
        self._drawn: dict[str, NDArray[np.int64]] = {}
        for one in measured:
            count = len(one.ids)
            self._drawn[one.benchmark] = rng.integers(0, max(count, 1), size=(resamples, count))

    def difference(
        self,
        network: Names,
        reference: Names,
        *,
        benchmarks: Sequence[str] = (),
        metric: str | None = None,
        named: tuple[str, str] | None = None,
    ) -> Difference:
        """A network against a reference, on the mean of benchmarks.

        Args:
            network: its name, or several whose scores are averaged.
            reference: likewise.
            benchmarks: which of the benchmarks; all unless given. Means weigh every benchmark alike.
            metric: on all of them; each one's own unless given.
            named: what to call both sides; needed where one is several networks.

        Raises:
            InputError: an unknown name or metric, or metrics of different units.
        """
        if benchmarks and (unknown := [name for name in benchmarks if name not in self.measured]):
            raise InputError(f"bootstrap: found {unknown}, expected some of {', '.join(self.measured)}")
        chosen = [self.measured[name] for name in benchmarks or self.measured]
        unit = common_unit(chosen, metric)
        parts = [self._part(one, network, reference, metric) for one in chosen]
        value = math.fsum(part[0] for part in parts) / len(parts)
        reason = next((part[2] for part in parts if part[2]), "")
        interval = None
        if not reason:
            draws = np.mean([part[1] for part in parts], axis=0)
            tail = 50.0 * (1.0 - self.level)
            low, high = np.percentile(draws, [tail, 100.0 - tail])
            interval = float(low), float(high)
        names = named or (_named(network), _named(reference))
        images = tuple(len(one.ids) for one in chosen)
        listed = tuple(one.benchmark for one in chosen)
        return Difference(*names, listed, images, unit, value, interval, self.level, reason)

    def _part(
        self, one: Measured, network: Names, reference: Names, metric: str | None
    ) -> tuple[float, NDArray[np.float64], str]:
        """One benchmark's difference, its draws, and why those say nothing (empty where they do)."""
        sides = [_terms(one, side, metric) for side in (network, reference)]
        if any(terms is None for terms in sides):
            return math.nan, np.empty(0), f"a network failed on {one.benchmark}"
        drawn = self._drawn[one.benchmark]
        whole: list[float] = []
        draws: list[NDArray[np.float64]] = []
        for terms in sides:
            assert terms is not None
            above, below = terms
            whole.append(float(above.sum() / below.sum()))
            draws.append(above[drawn].sum(axis=1) / below[drawn].sum(axis=1))
        if not all(map(math.isfinite, whole)):
            value = 0.0 if whole[0] == whole[1] else whole[0] - whole[1]
            return value, np.empty(0), f"a prediction on {one.benchmark} is not finite"
        if drawn.shape[1] < 2:
            return whole[0] - whole[1], np.empty(0), f"{one.benchmark} has one image"
        return whole[0] - whole[1], draws[0] - draws[1], ""


def paired_difference(
    measured: Measured | Sequence[Measured],
    network: Names,
    reference: Names,
    rng: np.random.Generator,
    *,
    metric: str | None = None,
    resamples: int = RESAMPLES,
    level: float = LEVEL,
) -> Difference:
    """A network against a reference on one benchmark or the mean of several, with its interval.

    Each benchmark's images are resampled with replacement within it, the same for both networks, and the
    protocol's aggregation is computed on each draw: means over images, or pooled over pixels. Use
    :class:`Resampling` to compare many networks on the same draws.

    Args:
        measured: from :func:`~sfkit.analysis.measured.measure_recipes`.
        network: its name; or several whose scores are averaged, such as a method's seeds.
        reference: likewise.
        rng: draws the images.
        metric: each benchmark's own unless given.
        resamples: how many draws.
        level: the interval's coverage.

    Raises:
        InputError: an unknown name or metric, metrics of different units, or no benchmark.
    """
    several = (measured,) if isinstance(measured, Measured) else tuple(measured)
    drawing = Resampling(several, rng, resamples=resamples, level=level)
    return drawing.difference(network, reference, metric=metric)


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
    units: Mapping[str, str] = {Metric.parse(metric or one.metric).unit: one.benchmark for one in measured}
    if len(units) != 1:
        raise InputError(
            f"benchmarks {', '.join(one.benchmark for one in measured)}: found metrics in "
            f"{' and '.join(units) or 'no unit'}, expected one unit for a mean: name one metric for all"
        )
    return next(iter(units))


def _terms(
    one: Measured, names: Names, metric: str | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Numerators and denominators of the mean score of several networks; None where one failed."""
    listed = (names,) if isinstance(names, str) else tuple(names)
    terms = [one.terms(name, metric=metric) for name in listed]
    if not terms or any(above.size == 0 for above, _ in terms):
        return None
    # All networks share the denominators, so that the mean of ratios is the ratio of means.
    return np.mean([above for above, _ in terms], axis=0), terms[0][1]


def _named(names: Names) -> str:
    return names if isinstance(names, str) else f"mean of {len(names)} runs"
