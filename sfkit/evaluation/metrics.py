"""Errors of one predicted disparity map: end-point error, bad-t and D1, as sums and counts.

All tests are strict (error > t). A prediction that is not finite somewhere counts as bad in all its
pixels, its end-point error is infinite, and it is flagged: ``nan > t`` is False and would score 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.metric import D1, D1_PIXELS, EPE, Map, Mask, Metric, Ratio, bad_pixels
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.regions import Regions, regions_of

THRESHOLDS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
REGIONS = ("all", "visible", "occluded", "edge")


@dataclass(frozen=True)
class Quantities:
    """What is kept of every image of an evaluation.

    Attributes:
        thresholds: in pixels, ascending; errors are counted above each.
        own: metrics that count something of their own, by name.
        needs_truth: False where every metric that was asked for works on pairs without ground truth.
    """

    thresholds: tuple[float, ...] = THRESHOLDS
    own: tuple[Metric, ...] = ()
    needs_truth: bool = True

    @classmethod
    def of(cls, *metrics: Metric | str) -> Quantities:
        """The default thresholds, and whatever else these metrics ask for."""
        parsed = {Metric.parse(metric) for metric in metrics}
        own = sorted((metric for metric in parsed if metric.recorder), key=lambda metric: metric.name)
        # Without a metric the usual errors are kept, which compare with ground truth.
        needs_truth = not parsed or any(metric.needs_truth for metric in parsed)
        return cls(thresholds_for(*parsed), tuple(own), needs_truth)

    def describe(self) -> dict[str, Any]:
        """Their part of an evaluation's key: nothing where only the usual errors are kept."""
        usual = {} if self.thresholds == THRESHOLDS else {"thresholds": list(self.thresholds)}
        return {**usual, **({"own": {m.name: m.version for m in self.own}} if self.own else {})}


@dataclass(frozen=True)
class RegionErrors:
    """Sums and counts over one region of one image.

    Attributes:
        pixels: how many pixels count.
        sum_abs: sum of absolute errors in pixels; ``inf`` where the prediction is not finite.
        above: how many errors exceed each threshold of the image's record.
        d1: how many errors exceed 3 px and 5 % of the ground truth.
    """

    pixels: int
    sum_abs: float
    above: tuple[int, ...]
    d1: int


@dataclass(frozen=True)
class ImageErrors:
    """Everything any metric needs of one image, by region.

    Attributes:
        id: the pair's name.
        thresholds: in pixels, ascending; what ``above`` counts.
        nonfinite: how many values of the whole predicted map are NaN or infinite.
        regions: ``all`` = the pixels the protocol counts; ``edge`` = those of them within
            ``EDGE_PIXELS`` of the image's border; ``visible`` and ``occluded``, where the data has a
            mask, split the pixels with ground truth whether or not the protocol counts occluded ones. None
            at all for a pair without ground truth.
        own: sum and count of each metric that counts something of its own, by name, of the whole image.
    """

    id: str
    thresholds: tuple[float, ...]
    nonfinite: int
    regions: Mapping[str, RegionErrors]
    own: Mapping[str, Ratio] = field(default_factory=dict)

    @property
    def flagged(self) -> bool:
        """True where the prediction is not finite everywhere."""
        return self.nonfinite > 0

    @property
    def pixels(self) -> int:
        """How many pixels the protocol counts."""
        return self.regions["all"].pixels if self.regions else 0

    def above(self, threshold: float, region: str = "all") -> int:
        """How many pixels of a region are off by more than ``threshold`` pixels.

        Raises:
            InputError: the region or the threshold was not recorded.
        """
        errors = self.region(region)
        if threshold not in self.thresholds:
            listed = ", ".join(f"{t:g}" for t in self.thresholds)
            name = bad_pixels(threshold)
            raise InputError(
                f"image {self.id!r}: {name} was not recorded, found the thresholds {listed} px; "
                f"evaluate again with thresholds=thresholds_for('{name}')"
            )
        return errors.above[self.thresholds.index(threshold)]

    def sums(self, metric: str, region: str = "all") -> Ratio:
        """Sum and count of a metric that counts something of its own.

        Raises:
            InputError: it was not recorded, or another region than ``all`` is asked for.
        """
        if region != "all":
            raise InputError(
                f"image {self.id!r}: {metric} is of the whole image, found region {region!r}, expected 'all'"
            )
        if metric not in self.own:
            raise InputError(
                f"image {self.id!r}: {metric} was not recorded, evaluate again with it among the metrics "
                f"(Evaluator(..., also=[{metric!r}]))"
            )
        return self.own[metric]

    def value(self, metric: Metric | str, region: str = "all") -> float:
        """The metric over one region, in its unit.

        Raises:
            InputError: an unknown metric or region, a threshold that was not recorded, or no pixel to count.
        """
        above, below = Metric.parse(metric).ratio(self, region)
        if below == 0:
            raise InputError(
                f"image {self.id!r}: found no valid pixel in region {region!r}, expected at least one"
            )
        return above / below

    def region(self, name: str) -> RegionErrors:
        """The sums and counts of one region.

        Raises:
            InputError: no such region, or the data could not tell it apart.
        """
        ensure_known("region", name, REGIONS)
        if not self.regions:
            raise InputError(
                f"image {self.id!r}: has no ground truth, expected a metric that needs none, or other pairs"
            )
        if name not in self.regions:
            raise InputError(
                f"image {self.id!r}: region {name!r} was not recorded, it needs an occlusion mask in the data"
            )
        return self.regions[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; an infinite sum is the string ``inf``."""
        own = {name: list(map(_plain, ratio)) for name, ratio in self.own.items()}
        return {
            "id": self.id,
            "thresholds": list(self.thresholds),
            "nonfinite": self.nonfinite,
            "regions": {
                name: {"pixels": r.pixels, "sum_abs": _plain(r.sum_abs), "above": list(r.above), "d1": r.d1}
                for name, r in self.regions.items()
            },
            **({"own": own} if own else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ImageErrors:
        """The inverse of :meth:`to_dict`.

        Raises:
            InputError: an entry is missing or of another kind.
        """
        try:
            regions = {
                str(name): RegionErrors(
                    int(r["pixels"]), float(r["sum_abs"]), tuple(map(int, r["above"])), int(r["d1"])
                )
                for name, r in data["regions"].items()
            }
            thresholds = tuple(map(float, data["thresholds"]))
            if any(len(r.above) != len(thresholds) for r in regions.values()):
                raise ValueError("counts that do not match the thresholds")
            own = {str(name): (float(above), float(n)) for name, (above, n) in data.get("own", {}).items()}
            return cls(str(data["id"]), thresholds, int(data["nonfinite"]), regions, own)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(
                f"image errors: {error!r} in the record, expected what ImageErrors.to_dict wrote"
            ) from error


def epe(prediction: Map, truth: Map, valid: Mask | None = None) -> float:
    """End-point error: mean |prediction - truth| over the valid pixels, in pixels.

    ``prediction`` and ``truth`` are (H, W) in pixels; ``valid`` is (H, W) bool, by default where the
    truth is finite and positive. A prediction that is not finite everywhere gives ``inf``.

    Raises:
        InputError: shapes differ, or no pixel is valid.
    """
    return _measure(EPE, prediction, truth, valid)


def bad(prediction: Map, truth: Map, threshold: float, valid: Mask | None = None) -> float:
    """Percent of the valid pixels off by more than ``threshold`` pixels; arguments as in :func:`epe`."""
    return _measure(Metric.parse(f"bad-{float(threshold)!r}"), prediction, truth, valid)


def d1(prediction: Map, truth: Map, valid: Mask | None = None) -> float:
    """Percent of the valid pixels that are off by more than 3 px and more than 5 % of the truth.

    KITTI 2015's outlier measure (Menze and Geiger, CVPR 2015); arguments as in :func:`epe`.
    """
    return _measure(D1, prediction, truth, valid)


def thresholds_for(*metrics: Metric | str) -> tuple[float, ...]:
    """The default thresholds and those that ``metrics`` ask for, ascending, in pixels."""
    return tuple(sorted({*THRESHOLDS, *(t for metric in metrics for t in Metric.parse(metric).thresholds)}))


def image_errors(
    prediction: Map,
    sample: Sample,
    valid: Mask,
    *,
    thresholds: Iterable[float] = THRESHOLDS,
) -> ImageErrors:
    """Sums and counts of one prediction for every metric at once.

    ``prediction`` is (H, W) disparity in pixels, ``valid`` (H, W) bool says which pixels count.

    Raises:
        InputError: prediction or mask has another shape than the sample.
    """
    _expect_shape(f"prediction for {sample.id!r}", prediction, sample.size)
    _expect_shape(f"valid mask for {sample.id!r}", valid, sample.size)
    return count_errors(prediction, regions_of(sample, valid), thresholds=thresholds)


def count_errors(
    prediction: Map, regions: Regions, *, thresholds: Iterable[float] = THRESHOLDS
) -> ImageErrors:
    """The same for ground truth that was sorted into regions before; ``prediction`` is (H, W) in pixels.

    Raises:
        InputError: the prediction has another shape than the ground truth.
    """
    _expect_shape(f"prediction for {regions.id!r}", prediction, regions.size)
    limits = tuple(sorted({float(t) for t in thresholds}))
    nonfinite = prediction.size - int(np.count_nonzero(np.isfinite(prediction)))
    if nonfinite:
        # One value that is not finite spoils the map: all its pixels count as wrong.
        sizes = {name: regions.pixels(name) for name in regions.inside}
        broken = {n: RegionErrors(k, math.inf if k else 0.0, (k,) * len(limits), k) for n, k in sizes.items()}
        return ImageErrors(regions.id, limits, nonfinite, broken)
    flat = prediction.ravel()
    used = flat if regions.used is None else flat.take(regions.used)
    # In float64, where differences of float32 are exact: thresholds are strict, and rounding must not cross
    # one.
    errors = np.subtract(used, regions.truth, dtype=np.float64)
    np.abs(errors, out=errors)
    counted = {name: _count(errors, regions, name, limits) for name in regions.inside}
    return ImageErrors(regions.id, limits, nonfinite, counted)


def _count(
    errors: NDArray[np.float64], regions: Regions, name: str, limits: tuple[float, ...]
) -> RegionErrors:
    inside, (near, bounds) = regions.inside[name], regions.near[name]
    own = errors if inside is None else errors.take(inside)
    flags = np.empty(len(own), np.bool_)
    # D1 is bad-3 less those that 5 % of a large disparity forgives: so few that all others need no second
    # test.
    above = {t: int(np.count_nonzero(np.greater(own, t, out=flags))) for t in {*limits, D1_PIXELS}}
    large = own.take(near)
    forgiven = int(np.count_nonzero((large > D1_PIXELS) & (large <= bounds)))
    counts = tuple(above[t] for t in limits)
    return RegionErrors(len(own), float(own.sum()), counts, above[D1_PIXELS] - forgiven)


def _plain(value: float) -> float | str:
    return value if math.isfinite(value) else "inf"


def _measure(metric: Metric, prediction: Map, truth: Map, valid: Mask | None) -> float:
    _expect_shape("prediction", prediction, truth.shape)
    # Files say 0 where nothing was measured.
    known = np.isfinite(truth) & (truth > 0)
    if valid is not None:
        _expect_shape("valid mask", valid, truth.shape)
        known &= valid
    if not known.any():
        raise InputError(f"{metric}: found no valid pixel, expected ground truth that is finite and positive")
    regions = Regions.of("array", truth, {"all": known})
    return count_errors(prediction, regions, thresholds=metric.thresholds).value(metric)


def _expect_shape(what: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise InputError(
            f"{what}: found shape {array.shape}, expected {tuple(shape)} as the ground truth has"
        )
