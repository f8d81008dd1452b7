"""Metrics: what is measured of a predicted disparity map, and all that the rest of sfkit asks about it.

A metric is one record: how its value comes from the sums and counts that are kept of every image, what it
is called, its unit, whether less is better. Whoever shows, averages, searches or draws scores asks the
record, so that a new metric is one call of :func:`register_metric` and nothing else.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from sfkit.errors import InputError, nearest

# A metric that is mistyped is told before arrays are imported.
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sfkit.datasets.pairs import Sample

D1_PIXELS = 3.0

Mask: TypeAlias = "NDArray[np.bool_]"
Map: TypeAlias = "NDArray[np.floating[Any]]"
Ratio = tuple[float, float]
"""A sum and what it is divided by, over the pixels of one image: pooled scores add both over images."""

Count: TypeAlias = "Callable[[Map], Ratio]"
"""The sum and count of one predicted disparity (H, W) in pixels of a pair that is known."""


class RegionSums(Protocol):
    """What was counted in one region of one image; see :class:`sfkit.evaluation.metrics.RegionErrors`."""

    @property
    def pixels(self) -> int: ...
    @property
    def sum_abs(self) -> float: ...
    @property
    def d1(self) -> int: ...


class ImageSums(Protocol):
    """What was counted of one image; see :class:`sfkit.evaluation.metrics.ImageErrors`."""

    def region(self, name: str) -> RegionSums: ...
    def above(self, threshold: float, region: str = "all") -> int: ...
    def sums(self, metric: str, region: str = "all") -> Ratio: ...


@dataclass(frozen=True)
class Metric:
    """One way to measure predicted disparity maps.

    A metric reads the errors that are counted of every image (``counts``), or has quantities of its own
    counted beside them (``recorder``); those are kept under the metric's name, and evaluations that hold
    them have keys of their own.

    Attributes:
        name: its one spelling in tables and keys, such as ``bad-1.0``.
        unit: ``%``, ``px`` or another.
        label: what it is called in prose and on axes; the name unless given.
        of: what a percentage is a share of.
        lower_is_better: a search minimises, so that a metric of which more is better cannot guide one.
        map_threshold: the error in pixels where an error map changes colour; None where none is special.
        pools: whether a protocol that pools pixels over all images does so for this metric.
        needs_truth: whether it compares with ground truth; one that does not works on pairs without any.
        thresholds: in pixels, those at which errors must be counted for it.
        counts: the ratio of one image, from what was counted in a region.
        recorder: makes, of a pair and of the mask (H, W) of pixels that count (all False without ground
            truth), the function that counts one prediction. It is called once a pair, what it makes for every
            prediction; a prediction that is not finite everywhere must get the worst value there is.
        on_device: whether the recorder takes, as a third argument, the name of the device where networks run,
            such as ``cuda:1``, to count there.
        version: of the recorder; part of the keys of evaluations that hold its quantities.
    """

    name: str
    unit: str = "%"
    label: str = ""
    of: str = "pixels"
    lower_is_better: bool = True
    map_threshold: float | None = None
    pools: bool = True
    needs_truth: bool = True
    thresholds: tuple[float, ...] = ()
    counts: Callable[[ImageSums, str], Ratio] | None = field(default=None, compare=False, repr=False)
    recorder: Callable[..., Count] | None = field(default=None, compare=False, repr=False)
    on_device: bool = field(default=False, compare=False, repr=False)
    version: str = "1"

    def __post_init__(self) -> None:
        if (self.counts is None) == (self.recorder is None):
            raise InputError(
                f"metric {self.name!r}: expected either counts, which read what is kept of every image, or a "
                "recorder, which counts something of its own: give one of them"
            )
        object.__setattr__(self, "label", self.label or self.name)

    @classmethod
    def parse(cls, text: str | Metric) -> Metric:
        """The metric called ``epe``, ``d1``, ``bad-T`` with T in pixels (also ``badT``), or as registered.

        Raises:
            InputError: no such metric, or a threshold that is not above 0.
        """
        if isinstance(text, Metric):
            return text
        name = text.strip().lower()
        if name in _METRICS:
            return _METRICS[name]
        match = _BAD.fullmatch(name)
        if match is None:
            hint = nearest(name, (*_METRICS, "bad-0.5", "bad-1.0", "bad-2.0", "bad-3.0"))
            known = ", ".join(_METRICS)
            raise InputError(f"unknown metric {text!r}, expected {known}, or bad-T with T in pixels{hint}")
        if not 0 < (threshold := float(match[1])) < math.inf:
            raise InputError(f"metric {text!r}: found the threshold {match[1]}, expected more than 0 pixels")
        return bad_pixels(threshold)

    def counter(self, sample: Sample, valid: Mask, device: str) -> Count | None:
        """What counts predictions of one pair beside a network on ``device``; None without a recorder."""
        if self.recorder is None:
            return None
        return self.recorder(sample, valid, device) if self.on_device else self.recorder(sample, valid)

    @property
    def axis(self) -> str:
        """The title of an axis, such as ``bad-1.0 (% of pixels)`` or ``EPE (px)``."""
        return f"{self.label} ({f'% of {self.of}' if self.unit == '%' else self.unit})"

    @property
    def kind(self) -> tuple[str, bool]:
        """What scores must share to be averaged or subtracted: the unit, and whether labels are behind it."""
        return self.unit, self.needs_truth

    def ratio(self, image: ImageSums, region: str = "all") -> Ratio:
        """Numerator and denominator of its value over one region of one image.

        Raises:
            InputError: the image's record has not what the metric reads.
        """
        return image.sums(self.name, region) if self.counts is None else self.counts(image, region)

    def __str__(self) -> str:
        return self.name


def _end_point(image: ImageSums, region: str) -> Ratio:
    errors = image.region(region)
    return errors.sum_abs, float(errors.pixels)


def _outliers(image: ImageSums, region: str) -> Ratio:
    errors = image.region(region)
    return 100.0 * errors.d1, float(errors.pixels)


def _above(threshold: float, image: ImageSums, region: str) -> Ratio:
    return 100.0 * image.above(threshold, region), float(image.region(region).pixels)


def bad_pixels(threshold: float) -> Metric:
    """Percent of pixels whose error exceeds a threshold in pixels (Scharstein and Szeliski, IJCV 2002)."""
    return Metric(
        f"bad-{threshold!r}",
        map_threshold=threshold,
        thresholds=(threshold,),
        counts=partial(_above, threshold),
    )


EPE = Metric("epe", unit="px", label="EPE", pools=False, counts=_end_point)
"""Mean absolute error, in pixels; the mean over images under every protocol."""

D1 = Metric("d1", label="D1", map_threshold=D1_PIXELS, counts=_outliers)
"""Percent of pixels off by more than 3 px and 5 % of the truth (KITTI 2015; Menze and Geiger, CVPR 2015)."""

_BAD = re.compile(r"bad[-_ ]?(\d+(?:\.\d+)?)")
_METRICS = {metric.name: metric for metric in (EPE, D1)}


def register_metric(metric: Metric) -> Metric:
    """Make a metric known by its name, wherever one is asked for; a second one of the name replaces it.

    Raises:
        InputError: a name that is not lower case, or one of sfkit's own.
    """
    name = metric.name
    if name != name.strip().lower() or not name or _BAD.fullmatch(name) or name in (EPE.name, D1.name):
        raise InputError(
            f"metric {name!r}: expected a name in lower case that is none of sfkit's own (epe, d1, bad-T): "
            "choose another"
        )
    _METRICS[name] = metric
    return metric


def metrics_of(*metrics: Metric | str) -> Sequence[Metric]:
    """Metrics by name, each once, in order; raises InputError for one that is unknown."""
    return tuple(dict.fromkeys(Metric.parse(metric) for metric in metrics))


def with_unit(name: str) -> str:
    """A metric's name with its unit; the name alone where it was registered elsewhere."""
    try:
        return f"{name} [{Metric.parse(name).unit}]"
    except InputError:
        return name


# The metric without ground truth registers itself: whoever can name metrics has it. It imports this module in
# its turn, so that this stands below all it needs.
importlib.import_module("sfkit.datasets.census")
