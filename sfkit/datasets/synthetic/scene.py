"""Scenes: surfaces drawn from a domain, everything by one generator."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from sfkit.datasets.synthetic import shapes
from sfkit.datasets.synthetic.domains import Domain
from sfkit.datasets.synthetic.surfaces import DisparityField, Shape, Skin, Surface
from sfkit.datasets.synthetic.textures import ground_skin, skin, tile

STEEPEST = 0.6
"""Bound on a surface's slope along x; at 1 the right view would see it edge-on."""


class Composer:
    """Draws the surfaces of one scene; every draw comes from the one generator, in a fixed order."""

    def __init__(self, domain: Domain, height: int, width: int, rng: Generator) -> None:
        self.domain, self.height, self.width, self.rng = domain, height, width, rng
        low, high = domain.disparity
        # As in pairs: the order of draws is part of what a seed means.
        self.far = float(low + rng.uniform(*domain.backdrop) * (high - low))
        self.near = float(rng.uniform(0.5 * (self.far + high), high))
        self.horizon = rng.uniform(0.15, 0.4) * height
        self.bottom = rng.uniform(0.7, 1.0) * self.near
        self.has_ground = bool(rng.random() < domain.ground)
        self.surfaces: list[Surface] = []

    def compose(self) -> list[Surface]:
        """Backdrop, ground, walls, things, thin things; the z-buffer, not the order, decides what shows."""
        # In this order of draws: any other would be other scenes under the same seed.
        rng, domain = self.rng, self.domain
        self.backdrop()
        if self.has_ground:
            self.ground()
        if rng.random() < domain.walls:
            self.walls()
        for _ in range(int(rng.integers(domain.objects[0], domain.objects[1] + 1))):
            self.box() if rng.random() < 0.3 else self.patch()
        for _ in range(int(rng.integers(domain.thin[0], domain.thin[1] + 1))):
            self.thin_thing()
        return self.surfaces

    def backdrop(self) -> None:
        """A far plane behind everything, a little slanted."""
        span = 0.5 * min(self.domain.slant, 0.1)
        # Tilted as far as its lowest corner keeps a positive disparity.
        room = 0.9 * (self.far - 0.6 * self.domain.disparity[0])
        slope_x, slope_y = self.rng.uniform(-span, span, size=2)
        shrink = min(1.0, room / (abs(slope_x) * self.width + abs(slope_y) * self.height / 2 + 1e-9))
        centre = (self.width / 2, self.height / 2)
        plane = DisparityField(centre, self.far, float(slope_x * shrink), float(slope_y * shrink))
        # Wide enough for the right view, which sees past the left image's right edge.
        box = (-self.width, 2.0 * self.width, 0.0, float(self.height))
        self._add(plane, shapes.everywhere(), self._skin(), box, reach=(-np.inf, np.inf))

    def ground(self) -> None:
        """A plane through the horizon, nearest at the bottom row."""
        # A plane through the camera's horizon: disparity is 0 there and grows linearly downwards.
        slope = self.bottom / (self.height - self.horizon)
        plane = DisparityField((self.width / 2, self.horizon), 0.0, 0.0, slope)
        texture = ground_skin(
            self._tile(), self.horizon, float(self.rng.uniform(60.0, 140.0)), self._texture_offset()
        )
        box = (-self.width, 2.0 * self.width, self.horizon, float(self.height))
        self._add(plane, shapes.everywhere(), texture, box, reach=(0.1, self.near + 1.0))

    def walls(self) -> None:
        """A wall on the left side, the right side, or both, nearest at the image's edge."""
        sides = self.rng.choice(3)
        for sign in (-1.0, 1.0):
            if sides == (0 if sign < 0 else 1):
                continue
            end = 0.5 + sign * self.rng.uniform(0.1, 0.35)
            edge = 0.5 + 0.5 * sign
            near = self.rng.uniform(0.6, 0.95) * self.near
            slope = sign * (near - self.far) / (abs(edge - end) * self.width)
            # A slope of 1 would fold the right view over itself.
            slope = float(np.clip(slope, -STEEPEST, STEEPEST))
            field = DisparityField((end * self.width, self.height / 2), self.far, slope)
            corner, outer = end * self.width, (0.5 + 1.5 * sign) * self.width
            box = (min(corner, outer), max(corner, outer), 0.0, float(self.height))
            self._add(field, shapes.everywhere(), self._skin(), box, reach=(0.1, self.near + 1.0))

    def patch(self) -> None:
        """A free-standing face: rectangle, ellipse or blob, flat or curved."""
        level = self._level()
        half = self._half_size(level)
        centre = self._place(level, half[1])
        outline, reach = self._outline(half)
        self._add(self._field(centre, level, reach), outline, self._skin(), self._box(centre, reach))

    def box(self) -> None:
        """Two faces that meet in an upright edge, nearest at the edge."""
        level = self._level()
        half_w, half_h = self._half_size(level)
        x, y = self._place(level, half_h)
        # Two faces that meet in the nearest edge and fall back to either side.
        split = self.rng.uniform(0.3, 0.7) * 2 * half_w
        fall = self.rng.uniform(0.3, 1.0, size=2) * min(0.3 * level, 0.8 * (level - self.domain.disparity[0]))
        for width, drop, sign in ((split, fall[0], -1.0), (2 * half_w - split, fall[1], 1.0)):
            slope = float(np.clip(-sign * drop / width, -STEEPEST, STEEPEST))
            left, right = (x - width, x) if sign < 0 else (x, x + width)
            box = (left, right, y - half_h, y + half_h)
            self._add(DisparityField((x, y), level, slope), shapes.everywhere(), self._skin(), box)

    def thin_thing(self) -> None:
        """A pole, a wire or a fence, in the nearer half of the scene."""
        rng = self.rng
        level = float(rng.uniform(0.45 * self.near, self.near))
        kind = rng.choice(3)
        if kind == 0:
            half = (float(rng.uniform(1.0, 2.6)), float(rng.uniform(0.25, 0.6) * self.height))
            outline, reach = shapes.rectangle(*half), half
        elif kind == 1:
            half = (float(rng.uniform(40.0, 160.0)), float(rng.uniform(0.8, 1.6)))
            angle = float(rng.uniform(0.2, 1.4) * rng.choice([-1.0, 1.0]))
            outline, reach = shapes.rectangle(*half, angle), (half[0], half[0])
        else:
            half = (float(rng.uniform(25.0, 70.0)), float(rng.uniform(18.0, 45.0)))
            period = float(rng.uniform(9.0, 20.0))
            outline = shapes.fence(*half, period, float(rng.uniform(2.0, 3.6)), int(rng.integers(0, 3)))
            reach = half
        centre = self._place(level, half[1])
        self._add(
            DisparityField(centre, level, float(rng.uniform(-0.03, 0.03))),
            outline,
            self._skin(),
            self._box(centre, reach),
        )

    def _level(self) -> float:
        low = self.far + 0.1 * (self.near - self.far)
        return float(self.rng.uniform(low, self.near))

    def _half_size(self, level: float) -> tuple[float, float]:
        """Half width and height in pixels; near things look larger."""
        # Near things look larger, as in a camera; not in full, or far ones would be specks.
        closeness = 0.5 + 0.5 * level / self.near
        wide, high = self.rng.uniform(0.05, 0.16, size=2) * self.width * closeness
        return float(wide), float(high)

    def _place(self, level: float, half_height: float) -> tuple[float, float]:
        """A centre; with a ground plane, the one that makes the thing stand on it at its own depth."""
        x = float(self.rng.uniform(-0.02, 1.05) * self.width)
        y = float(self.rng.uniform(0.05, 0.95) * self.height)
        if self.has_ground:
            # Where the ground has the thing's own disparity: it stands there, and does not float.
            foot = self.horizon + level / self.bottom * (self.height - self.horizon)
            return x, foot - half_height
        return x, y

    def _outline(self, half: tuple[float, float]) -> tuple[Shape, tuple[float, float]]:
        """An outline of about the given half size, and the half size of its bounding box."""
        kind = self.rng.choice(3)
        if kind == 0:
            # What stands on the ground stands upright.
            angle = 0.0 if self.has_ground else float(self.rng.uniform(-0.6, 0.6))
            cos, sin = abs(np.cos(angle)), abs(np.sin(angle))
            return shapes.rectangle(*half, angle), (
                half[0] * cos + half[1] * sin,
                half[0] * sin + half[1] * cos,
            )
        if kind == 1:
            return shapes.ellipse(*half), half
        waves = tuple(
            (float(self.rng.uniform(0.0, 0.16)), float(self.rng.uniform(0.0, 6.28))) for _ in range(3)
        )
        # Of an ellipse's area, were its outline round.
        radius = float(np.sqrt(half[0] * half[1]))
        bound = radius * (1.0 + sum(a for a, _ in waves))
        return shapes.blob(radius, waves), (bound, bound)

    def _field(self, centre: tuple[float, float], level: float, reach: tuple[float, float]) -> DisparityField:
        """A tilted or bulging field that stays within the domain's disparities on its bounding box."""
        low, high = self.domain.disparity
        room = max(0.0, min(level - low, high - level))
        slope_x, slope_y = self.rng.uniform(-1.0, 1.0, size=2) * self.domain.slant
        swing = abs(slope_x) * reach[0] + abs(slope_y) * reach[1] + 1e-9
        # Flattened, so that no place leaves the domain's range.
        shrink = min(1.0, room / swing)
        if self.rng.random() >= self.domain.curved:
            return DisparityField(centre, level, float(slope_x * shrink), float(slope_y * shrink))
        # Bulges towards the camera, within the domain's range and no steeper than it is wide.
        depth = min(self.rng.uniform(0.1, 0.3) * level, 0.9 * (level - low), 0.4 * min(reach))
        return DisparityField(
            centre, level, 0.0, 0.0, -0.5 * depth / reach[0] ** 2, -0.5 * depth / reach[1] ** 2
        )

    def _tile(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        # The order in which a table lists them must not decide what a seed draws.
        kinds = sorted(self.domain.textures)
        weights = np.array([self.domain.textures[kind] for kind in kinds])
        kind = str(self.rng.choice(kinds, p=weights / weights.sum()))
        return tile(kind, self.rng, float(self.rng.uniform(*self.domain.contrast)))

    def _skin(self) -> Skin:
        texture = self._tile()
        scale, angle = float(self.rng.uniform(0.5, 0.95)), float(self.rng.uniform(-0.5, 0.5))
        return skin(texture, scale, angle, self._texture_offset())

    def _texture_offset(self) -> tuple[float, float]:
        u, v = self.rng.uniform(0.0, 400.0, size=2)
        return float(u), float(v)

    @staticmethod
    def _box(centre: tuple[float, float], reach: tuple[float, float]) -> tuple[float, float, float, float]:
        return (centre[0] - reach[0], centre[0] + reach[0], centre[1] - reach[1], centre[1] + reach[1])

    def _add(
        self,
        field: DisparityField,
        outline: Shape,
        texture: Skin,
        box: tuple[float, float, float, float],
        reach: tuple[float, float] | None = None,
    ) -> None:
        self.surfaces.append(Surface(field, outline, texture, box, reach or (0.1, self.near + 20.0)))
