"""Outlines of surfaces: functions of (x, y) relative to a centre, in pixels, true inside."""

from __future__ import annotations

import numpy as np

from sfkit.datasets.synthetic.surfaces import Array, Mask, Shape


def everywhere() -> Shape:
    """No outline: the surface's box alone bounds it."""

    def inside(x: Array, y: Array) -> Mask:
        return np.ones(np.broadcast(x, y).shape, dtype=bool)

    return inside


def rectangle(half_width: float, half_height: float, angle: float = 0.0) -> Shape:
    """A rectangle turned by ``angle`` radians."""
    cos, sin = np.cos(angle), np.sin(angle)

    def inside(x: Array, y: Array) -> Mask:
        along, across = cos * x + sin * y, cos * y - sin * x
        return np.asarray((np.abs(along) <= half_width) & (np.abs(across) <= half_height))

    return inside


def ellipse(half_width: float, half_height: float) -> Shape:
    """An upright ellipse."""

    def inside(x: Array, y: Array) -> Mask:
        return (x / half_width) ** 2 + (y / half_height) ** 2 <= 1.0

    return inside


def blob(radius: float, waves: tuple[tuple[float, float], ...]) -> Shape:
    """A rounded outline: ``radius`` varied by (amplitude, phase) of the second, third, ... angular wave."""

    def inside(x: Array, y: Array) -> Mask:
        angle = np.arctan2(y, x)
        # From two waves around it on: a single one would only move the outline.
        bound = 1.0 + sum(a * np.cos((k + 2) * angle + p) for k, (a, p) in enumerate(waves))
        return x * x + y * y <= (radius * bound) ** 2

    return inside


def fence(half_width: float, half_height: float, period: float, bar: float, rails: int) -> Shape:
    """Upright bars ``bar`` pixels wide every ``period`` pixels, held by ``rails`` bars across."""
    heights = np.linspace(-0.8, 0.8, rails) * half_height if rails else np.empty(0)

    def inside(x: Array, y: Array) -> Mask:
        solid = np.mod(x + half_width, period) < bar
        for height in heights:
            solid |= np.abs(y - height) <= bar / 2
        return solid & (np.abs(x) <= half_width) & (np.abs(y) <= half_height)

    return inside
