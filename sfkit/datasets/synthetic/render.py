"""Two views of a scene by z-buffer, with exact disparity and visibility.

The disparity at a pixel is that of the nearest surface (the largest disparity) there; a left pixel is
visible in the right view if nothing nearer projects onto the same right-image point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.synthetic.surfaces import Array, Mask, Surface

SAME_DEPTH = 1e-6
"""Pixels of disparity within which two points are taken for one: rounding, never geometry."""


@dataclass(frozen=True)
class Hits:
    """What a view's rays meet: surface index (-1 for nothing), disparity and left-image x, all (H, W)."""

    surface: NDArray[np.int16]
    disparity: Array
    left_x: Array


@dataclass(frozen=True)
class Views:
    """Both views of a scene, before any camera.

    Attributes:
        left: radiance (H, W, 3), 0..1.
        right: radiance (H, W, 3), 0..1.
        disparity: of the left pixels, (H, W), pixels.
        right_disparity: of the right pixels, (H, W), pixels.
        visible: left pixels that the right view shows too, (H, W).
    """

    left: Array
    right: Array
    disparity: Array
    right_disparity: Array
    visible: Mask


def render(surfaces: Sequence[Surface], height: int, width: int) -> Views:
    """Both views of ``surfaces``, one of which must fill the view (a backdrop)."""
    x = np.broadcast_to(np.arange(width, dtype=np.float64), (height, width))
    left = left_hits(surfaces, height, width)
    right = right_hits(surfaces, x)
    landing = x - left.disparity
    # At the exact places where left pixels land, not at whole pixels of the right view.
    nearest = right_hits(surfaces, landing).disparity
    visible = (landing >= 0.0) & (landing <= width - 1.0) & (nearest <= left.disparity + SAME_DEPTH)
    return Views(
        left=_colours(surfaces, left),
        right=_colours(surfaces, right),
        disparity=left.disparity,
        right_disparity=right.disparity,
        visible=visible,
    )


def left_hits(surfaces: Sequence[Surface], height: int, width: int) -> Hits:
    """The nearest surface at every pixel of the left view."""
    hits = _nothing(height, width)
    for index, surface in enumerate(surfaces):
        left, right, top, bottom = surface.box
        rows, columns = _span(top, bottom, height), _span(left, right, width)
        y = np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]
        x = np.arange(columns.start, columns.stop, dtype=np.float64)[None, :]
        if y.size and x.size:
            _offer(hits, (rows, columns), index, surface, np.broadcast_to(x, (len(y), x.shape[1])), y)
    return hits


def right_hits(surfaces: Sequence[Surface], x_right: Array) -> Hits:
    """The nearest surface at right-view positions ``x_right`` (H, W) of rows 0..H-1, not only whole ones."""
    height, width = x_right.shape
    hits = _nothing(height, width)
    for index, surface in enumerate(surfaces):
        rows = _span(surface.box[2], surface.box[3], height)
        y = np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]
        if y.size:
            # Solved for the left image's column, where a surface's outline and colours live.
            x = surface.field.left_x(x_right[rows], y)
            _offer(hits, (rows, slice(0, width)), index, surface, x, y, x - x_right[rows])
    return hits


def _nothing(height: int, width: int) -> Hits:
    shape = (height, width)
    return Hits(np.full(shape, -1, np.int16), np.full(shape, -np.inf), np.zeros(shape))


def _span(low: float, high: float, size: int) -> slice:
    """The whole numbers of 0..size-1 in [low, high]; empty where there are none."""
    start = int(np.clip(np.ceil(low), 0, size))
    return slice(start, max(start, int(np.clip(np.floor(high) + 1, 0, size))))


def _offer(
    hits: Hits,
    window: tuple[slice, slice],
    index: int,
    surface: Surface,
    x: Array,
    y: Array,
    disparity: Array | None = None,
) -> None:
    """Let the surface take the rays it is nearest to (the first of equals keeps them)."""
    seen = surface.field.at(x, y) if disparity is None else disparity
    # A z-buffer in disparity: the larger one is nearer. The cheap test first, then the outline.
    wins = seen > hits.disparity[window]
    wins &= surface.covers(x, y, seen)
    hits.surface[window][wins] = index
    hits.disparity[window][wins] = seen[wins]
    hits.left_x[window][wins] = x[wins]


def _colours(surfaces: Sequence[Surface], hits: Hits) -> Array:
    image = np.zeros((*hits.surface.shape, 3))
    for index, surface in enumerate(surfaces):
        rows, columns = np.nonzero(hits.surface == index)
        if len(rows):
            image[rows, columns] = surface.skin(hits.left_x[rows, columns], rows.astype(np.float64))
    return image
