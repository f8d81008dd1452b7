"""What a prediction is compared with on a pair: its ground truth, or the right image where there is none.

Both give a map of the same kind, in which little is right and much is wrong, so that whoever draws, compares
or lists regions of one does it of the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.census import CensusTarget
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError
from sfkit.evaluation.self_check import mean_around

Map = NDArray[np.float32]

DEFAULT_THRESHOLD = 1.0
"""Pixels; where an error map changes colour when the metric names no threshold (EPE)."""

RESIDUAL_THRESHOLD = 12.5
"""Percent; where a residual map changes colour: a quarter of what unrelated images have."""


@dataclass(frozen=True)
class MapKind:
    """What a map holds.

    Attributes:
        name: ``error`` or ``residual``.
        unit: of its values and thresholds.
        missing: what a hatched pixel lacks.
    """

    name: str
    unit: str
    missing: str


ERROR_MAP = MapKind("error", "px", "no ground truth")
"""|prediction - ground truth| in pixels."""

RESIDUAL_MAP = MapKind("residual", "%", "no match inside the right image")
"""Percent of census bits by which the left image differs from the right one warped by the prediction."""


@dataclass(frozen=True, eq=False)
class Comparand:
    """What predictions of one pair are compared with.

    Attributes:
        sample: the pair.
        truth: (H, W) float32 pixels, NaN where there is no ground truth that counts; NaN everywhere where a
            pair has none, and then the right image stands for it.
        threshold: in the kind's unit; where a map of it changes colour.
    """

    sample: Sample
    truth: Map
    threshold: float

    @classmethod
    def of(cls, sample: Sample, truth: Map, *metrics: Metric) -> Comparand:
        """A pair's, with the threshold of the metrics (:func:`map_threshold`), or that of residuals."""
        labelled = bool(np.isfinite(truth).any())
        return cls(sample, truth, map_threshold(*metrics) if labelled else RESIDUAL_THRESHOLD)

    @cached_property
    def labelled(self) -> bool:
        """Whether any ground truth counts."""
        return bool(np.isfinite(self.truth).any())

    @property
    def kind(self) -> MapKind:
        """What :meth:`map` holds."""
        return ERROR_MAP if self.labelled else RESIDUAL_MAP

    @cached_property
    def _target(self) -> CensusTarget:
        return CensusTarget(self.sample.left, self.sample.right)

    def map(self, prediction: Map) -> Map:
        """Where a prediction (H, W) in pixels is wrong: see :func:`error_map` and :func:`residual_map`."""
        if self.labelled:
            return error_map(prediction, self.truth)
        return residual_map(prediction, self._target)

    def reduced(self, left: NDArray[np.uint8], right: NDArray[np.uint8], reduction: int) -> Comparand:
        """The same for predictions of both images averaged down, in pixels of that size.

        Args:
            left: (H / reduction, W / reduction, 3) RGB uint8.
            right: the same of the right image.
            reduction: by how much height and width were divided.
        """
        # Picked: a mean across an edge is a depth that nothing has. Disparities shrink with the width.
        truth = self.truth[::reduction, ::reduction] / np.float32(reduction)
        small = Sample(self.sample.id, left, right, truth)
        return Comparand(small, truth, self.threshold)

    def limits(self, prediction: Map) -> tuple[float, float]:
        """The colour range of disparities: of the ground truth, else of ``prediction``, in pixels."""
        if self.labelled:
            return disparity_limits(self.truth)
        finite = np.isfinite(prediction)
        return disparity_limits(prediction) if finite.any() else (0.0, self.sample.size[1] / 4)


def disparity_limits(disparity: Map) -> tuple[float, float]:
    """A colour range for one pair: the 1st and 99th percentile of its disparities, in pixels.

    The range is rounded outwards to whole pixels and is at least one pixel wide.

    Raises:
        InputError: no finite disparity at all.
    """
    known = disparity[np.isfinite(disparity)]
    if known.size == 0:
        raise InputError("ground truth: found no valid pixel, expected at least one to set a colour range")
    # One wild pixel would stretch the range until all others look alike.
    low, high = np.percentile(known, [1.0, 99.0])
    bottom = int(np.floor(low))
    return float(bottom), float(max(int(np.ceil(high)), bottom + 1))


def error_map(prediction: Map, truth: Map) -> Map:
    """|prediction - truth| (H, W) in pixels: NaN without ground truth, inf without a finite prediction."""
    # NaN would say that there is no ground truth.
    finite = np.where(np.isfinite(prediction), prediction, np.float32(np.inf))
    return np.asarray(np.abs(finite - truth), dtype=np.float32)


def residual_map(prediction: Map, target: CensusTarget) -> Map:
    """Percent of differing census bits (H, W), averaged around each pixel as a prediction's confidence is.

    NaN where the match lies outside of the right image and at the border, inf without a finite prediction.
    """
    residuals = target.map(prediction)
    known = np.isfinite(residuals)
    averaged = np.where(known, mean_around(residuals), np.float32(np.nan))
    return np.asarray(np.where(np.isfinite(prediction), averaged, np.float32(np.inf)), dtype=np.float32)


def map_threshold(*metrics: Metric) -> float:
    """The error in pixels where an error map changes colour: that of the first metric that has one, else 1.

    A threshold that was asked for (bad-T) goes before one that a metric brings along (D1).
    """
    # Metrics that name a threshold come first.
    found = [m.map_threshold for m in sorted(metrics, key=lambda metric: not metric.thresholds)]
    return next((threshold for threshold in found if threshold is not None), DEFAULT_THRESHOLD)
