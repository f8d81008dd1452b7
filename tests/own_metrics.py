"""Metrics as a user would add them: a function that counts, and one call that makes it known."""

from __future__ import annotations

import math

import numpy as np

from sfkit.datasets import Sample
from sfkit.datasets.metric import Count, Map, Mask, Metric, Ratio, register_metric

made: list[str] = []
"""The pairs that ``outside`` has been made for so far."""


def outside(sample: Sample, valid: Mask) -> Count:
    """Percent of pixels whose match lies outside the right image; needs no ground truth."""
    made.append(sample.id)
    columns = np.arange(sample.size[1])

    def count(prediction: Map) -> Ratio:
        if not np.isfinite(prediction).all():
            return 100.0 * prediction.size, float(prediction.size)
        return 100.0 * np.count_nonzero(columns - prediction < 0), float(prediction.size)

    return count


def squared(sample: Sample, valid: Mask) -> Count:
    """Mean squared error in square pixels."""

    def count(prediction: Map) -> Ratio:
        if not np.isfinite(prediction).all():
            return math.inf, 1.0
        return float(np.square(prediction - sample.disparity)[valid].sum()), float(valid.sum())

    return count


def within(sample: Sample, valid: Mask) -> Count:
    """Percent of pixels right to one pixel."""

    def count(prediction: Map) -> Ratio:
        off = np.abs(prediction - sample.disparity)[valid]
        return 100.0 * np.count_nonzero(off <= 1.0), float(valid.sum())

    return count


def placed(sample: Sample, valid: Mask, device: str) -> Count:
    """Where it was told that networks run: 0 on the CPU, else the number of the device."""
    number = float(device.partition(":")[2] or 0)
    return lambda prediction: (number, 1.0)


OUTSIDE = register_metric(Metric("outside", of="matches", needs_truth=False, recorder=outside))
SQUARED = register_metric(Metric("squared", unit="px²", label="MSE", pools=False, recorder=squared))
WITHIN = register_metric(Metric("within-1", lower_is_better=False, map_threshold=1.0, recorder=within))
PLACED = register_metric(Metric("placed", unit="", needs_truth=False, recorder=placed, on_device=True))
