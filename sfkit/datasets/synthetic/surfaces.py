"""Surfaces whose disparity is known in closed form, in the left view and in the right one.

Coordinates are those of the left image, in pixels: x to the right, y down, pixel centres at whole
numbers. A surface's disparity is a quadratic in x and y (a plane's is affine), so the map from left
to right, x_right = x - d(x, y), is inverted by the quadratic formula and nothing is approximated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Shape = Callable[[Array, Array], Mask]
"""(x, y) relative to the surface's centre, pixels -> where the surface is."""
Skin = Callable[[Array, Array], Array]
"""(x, y) of shape (N,), left-image pixels -> colours (N, 3), 0..1."""


@dataclass(frozen=True)
class DisparityField:
    """d = level + slope_x u + slope_y v + curve_x u^2 + curve_y v^2 with (u, v) = (x, y) - centre; pixels."""

    centre: tuple[float, float]
    level: float
    slope_x: float = 0.0
    slope_y: float = 0.0
    curve_x: float = 0.0
    curve_y: float = 0.0

    def at(self, x: Array, y: Array) -> Array:
        """Disparity in pixels at left-image coordinates."""
        u, v = x - self.centre[0], y - self.centre[1]
        along_x = self.slope_x * u if self.curve_x == 0.0 else (self.slope_x + self.curve_x * u) * u
        return along_x + self._along_y(v)

    def left_x(self, x_right: Array, y: Array) -> Array:
        """The left-image x seen at (x_right, y) of the right view; NaN where the surface has no such point.

        Of the two roots this is the one where x - d(x) increases with x, the only one that a surface
        shows its front on.
        """
        known = x_right - self.centre[0] + self._along_y(y - self.centre[1])
        linear = 1.0 - self.slope_x
        if self.curve_x == 0.0:
            return self.centre[0] + known / linear
        square = linear * linear - 4.0 * self.curve_x * known
        root = np.sqrt(np.where(square >= 0.0, square, np.nan))
        # This form of the root takes no difference of like numbers, and holds where the curve is nearly none.
        return self.centre[0] + 2.0 * known / (linear + root)

    def _along_y(self, v: Array) -> Array:
        return self.level + (self.slope_y + self.curve_y * v) * v


@dataclass(frozen=True)
class Surface:
    """A textured piece of a disparity field.

    Attributes:
        field: its disparity.
        shape: its outline.
        skin: its colours.
        box: left, right, top, bottom of the outline in left-image pixels; nothing of it lies outside.
        reach: smallest and largest disparity inside the box; points outside this range are not there.
    """

    field: DisparityField
    shape: Shape
    skin: Skin
    box: tuple[float, float, float, float]
    reach: tuple[float, float]

    def covers(self, x: Array, y: Array, disparity: Array) -> Mask:
        """Where the surface exists, at left-image coordinates whose disparity on it is given."""
        left, right, top, bottom = self.box
        inside = (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
        inside &= (disparity >= self.reach[0]) & (disparity <= self.reach[1])
        return inside & self.shape(x - self.field.centre[0], y - self.field.centre[1])
