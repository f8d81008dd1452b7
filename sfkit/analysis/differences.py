"""Where is one network better than another, and where is it far off? Maps and regions of one pair."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.analysis.disparities import Comparison, DisparityPanels
from sfkit.analysis.pair_maps import Map
from sfkit.errors import InputError, ensure_known

Pixels = tuple[NDArray[np.intp], ...]  # rows and columns

GAP = 4
"""Bad pixels at most this many pixels apart belong to one region; sparse ground truth has such gaps."""

LARGE_SHARE = 0.5
"""A region wider or higher than this share of the image says nothing, and is split."""

SMALLEST = 8
"""Regions of fewer bad pixels are not listed."""


@dataclass(frozen=True, eq=False)
class Advantage:
    """One network against a reference on one pair.

    Attributes:
        difference: (H, W) float32 pixels, the network's error minus the reference's: negative where the
            network is nearer to the ground truth. NaN where no pixel counts, 0 where neither prediction
            is finite, infinite where one of them is not.
        fixed: percent of the counted pixels that the reference has beyond the threshold and the network
            does not.
        broken: percent the other way round; bad-t of the network is that of the reference, less
            ``fixed``, plus ``broken``.
    """

    difference: Map
    fixed: float
    broken: float


@dataclass(frozen=True, eq=False)
class AdvantagePanels:
    """What a figure of one network against another draws.

    Attributes:
        pair: images, ground truth, threshold.
        reference: the one network's name.
        network: the other's.
        advantage: of ``network`` against ``reference``.
    """

    pair: DisparityPanels
    reference: str
    network: str
    advantage: Advantage


@dataclass(frozen=True)
class OutlierRegion:
    """Pixels close to each other whose error is large.

    Attributes:
        x: left edge of their box in the image, in pixels.
        y: its upper edge.
        width: its width in pixels.
        height: its height.
        pixels: how many bad pixels are in the region.
        above: the error in pixels that all of them exceed: the threshold, or 2, 4, ... times it where a
            larger region was split.
        mean: their mean error in pixels; infinite where a prediction is not finite.
        worst: their largest error in pixels.
        peak: column and row of the worst pixel.
    """

    x: int
    y: int
    width: int
    height: int
    pixels: int
    above: float
    mean: float
    worst: float
    peak: tuple[int, int]


def advantage(reference: Map, network: Map, threshold: float) -> Advantage:
    """Compare two error maps.

    Args:
        reference: (H, W) absolute errors in pixels, NaN where no pixel counts, ``inf`` where the
            prediction is not finite (:func:`~sfkit.analysis.pair_maps.error_map`).
        network: the same of the other network.
        threshold: in pixels; an error is bad beyond it.

    Raises:
        InputError: maps of different shapes, or no pixel that counts in both.
    """
    if reference.shape != network.shape:
        raise InputError(f"error maps: found shapes {reference.shape} and {network.shape}, expected one")
    counted = ~(np.isnan(reference) | np.isnan(network))
    total = np.count_nonzero(counted)
    if total == 0:
        raise InputError("error maps: found no pixel that counts in both, expected at least one")
    # inf - inf is NaN, which would say that no pixel counts.
    both = np.isinf(reference) & np.isinf(network)
    with np.errstate(invalid="ignore"):
        difference = np.where(both, np.float32(0), network - reference)
        before, after = counted & (reference > threshold), counted & (network > threshold)
    fixed = 100.0 * np.count_nonzero(before & ~after) / total
    broken = 100.0 * np.count_nonzero(after & ~before) / total
    return Advantage(np.asarray(difference, dtype=np.float32), fixed, broken)


def advantage_panels(pair: DisparityPanels, reference: str, network: str) -> AdvantagePanels:
    """Compare two of a pair's networks by name.

    Raises:
        InputError: a name the pair does not have.
    """
    errors = {maps.name: maps.error for maps in pair.networks}
    for name in (reference, network):
        ensure_known("network", name, errors)
    found = advantage(errors[reference], errors[network], pair.threshold)
    return AdvantagePanels(pair, reference, network, found)


def advantage_table(comparison: Comparison, reference: str, network: str) -> pd.DataFrame:
    """What ``network`` fixes and breaks against ``reference`` on every pair of a benchmark, in percent.

    One row a pair, indexed by its id, where the network gains most first: ``fixed`` and ``broken`` as in
    :class:`Advantage`, and ``change``, their difference, negative where the network is better.

    Raises:
        InputError: a name the comparison does not have, or a pair that cannot be scored.
    """
    rows = {}
    for pair in comparison.pairs:
        found = advantage_panels(comparison.panels(pair), reference, network).advantage
        rows[pair] = {"fixed": found.fixed, "broken": found.broken, "change": found.broken - found.fixed}
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis(index="pair")
    # Stable: pairs of equal change stay in the benchmark's order.
    return table.sort_values("change", kind="stable")


def outlier_regions(error: Map, threshold: float, *, most: int = 12) -> tuple[OutlierRegion, ...]:
    """Find where a network is wrong, the region with most bad pixels first.

    Bad pixels up to :data:`GAP` apart form a region. One that spans more than :data:`LARGE_SHARE` of the
    image's width or height is split into what exceeds twice the threshold, and again.

    Args:
        error: (H, W) absolute errors in pixels, NaN where no pixel counts.
        threshold: in pixels; an error is bad beyond it.
        most: how many regions at most; those of fewer than :data:`SMALLEST` pixels are never listed.

    Raises:
        InputError: a threshold that is not above 0.
    """
    if not 0 < threshold < math.inf:
        raise InputError(f"threshold: found {threshold}, expected more than 0 pixels")
    found: list[OutlierRegion] = []
    with np.errstate(invalid="ignore"):
        waiting = deque((part, threshold) for part in _groups(np.nonzero(error > threshold), error.shape))
    # It ends: each half exceeds twice the level of its whole, and groups of infinite errors are not split.
    while waiting:
        part, level = waiting.popleft()
        region = _region(error, part, level)
        large = region.width > LARGE_SHARE * error.shape[1] or region.height > LARGE_SHARE * error.shape[0]
        halves = _split(error, part, 2 * level) if large else []
        waiting.extend((half, 2 * level) for half in halves)
        if not halves:
            found.append(region)
    # Of equal size the upper left one first: the list is the same every time.
    return tuple(sorted(found, key=lambda region: (-region.pixels, region.y, region.x))[:most])


def _split(error: Map, part: Pixels, level: float) -> list[Pixels]:
    """The groups within ``part`` whose errors exceed ``level``; none where only infinite errors do."""
    above = error[part] > level
    # Where all of it is infinite no higher level tells parts apart.
    if not np.isfinite(error[part][above]).any():
        return []
    return _groups((part[0][above], part[1][above]), error.shape)


def _groups(bad: Pixels, shape: tuple[int, ...]) -> list[Pixels]:
    """Pixels at most :data:`GAP` apart belong together; groups large enough to list."""
    mask = np.zeros(shape, np.uint8)
    mask[bad] = 1
    # Each pixel grows by half the gap, so that two that far apart touch.
    joined = cv2.dilate(mask, np.ones((GAP, GAP), np.uint8))
    labels = cv2.connectedComponents(joined, connectivity=8)[1][bad]
    # By label, so that each group is one run of the order.
    order = np.argsort(labels, kind="stable")
    cuts = np.flatnonzero(np.diff(labels[order])) + 1
    return [(bad[0][part], bad[1][part]) for part in np.split(order, cuts) if part.size >= SMALLEST]


def _region(error: Map, part: Pixels, level: float) -> OutlierRegion:
    rows, columns = part
    # In double: a sum of many float32 loses digits.
    values = error[part].astype(np.float64)
    peak = int(values.argmax())
    return OutlierRegion(
        x=int(columns.min()),
        y=int(rows.min()),
        width=int(np.ptp(columns)) + 1,
        height=int(np.ptp(rows)) + 1,
        pixels=values.size,
        above=level,
        mean=float(values.mean()),
        worst=float(values[peak]),
        peak=(int(columns[peak]), int(rows[peak])),
    )
