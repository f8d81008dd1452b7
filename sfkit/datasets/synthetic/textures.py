"""Procedural textures: band-limited tiles, and skins that sample them continuously.

A skin is a function of the surface's own continuous coordinates, so both views read the same
values at the same surface point; no resampled picture stands between them.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.random import Generator

from sfkit.datasets.synthetic.surfaces import Array, Skin

TILE = 288
"""Side of a texture tile, texels; tiles repeat mirrored, so that they have no seam."""


def skin(tile: Array, scale: float, angle: float, offset: tuple[float, float]) -> Skin:
    """The tile on the left image: ``scale`` texels a pixel, turned by ``angle``, moved by ``offset``."""
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)

    def colours(x: Array, y: Array) -> Array:
        return _sample(tile, cos * x + sin * y + offset[0], cos * y - sin * x + offset[1])

    return colours


def ground_skin(tile: Array, horizon: float, scale: float, offset: tuple[float, float]) -> Skin:
    """The tile laid on a plane that rises to ``horizon`` (a row): finer and smoother with distance.

    ``scale`` is the distance in rows below the horizon at which a texel is a pixel wide. A texel
    narrower than a pixel is averaged along x first (a chain of halved tiles), the same way in both views.
    """
    # Halved again and again (a mip map): far ground would alias, and no matching could be right there.
    chain = [tile]
    while chain[-1].shape[0] > 3:
        half = cv2.resize(chain[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        chain.append(np.asarray(half, dtype=np.float64))

    def colours(x: Array, y: Array) -> Array:
        below = np.maximum(y - horizon, 0.5)
        width = scale / below  # texels under one pixel
        # The chain's last level has no coarser one to be mixed with.
        level = np.clip(np.log2(np.maximum(width, 1.0)), 0.0, len(chain) - 1.001)
        u, v = x * width + offset[0], scale * scale / below + offset[1]
        floor = np.floor(level).astype(np.intp)
        result = np.empty((len(x), 3))
        for step in np.unique(floor):
            at = floor == step
            share = (level[at] - step)[:, None]
            fine = _sample(chain[step], u[at] / 2.0**step, v[at] / 2.0**step)
            coarse = _sample(chain[step + 1], u[at] / 2.0 ** (step + 1), v[at] / 2.0 ** (step + 1))
            result[at] = fine * (1.0 - share) + coarse * share
        return result

    return colours


def tile(kind: str, rng: Generator, contrast: float) -> Array:
    """A texture tile (TILE, TILE, 3), 0..1, of one of the ``KINDS``; ``contrast`` scales its variation."""
    ink, paper = _two_colours(rng)
    pattern = KINDS[kind](rng)
    blots = rng.uniform(-1.0, 1.0, size=(12, 12, 3))
    stains = np.asarray(cv2.resize(blots, (TILE, TILE), interpolation=cv2.INTER_CUBIC), dtype=np.float64)
    shade = 0.5 + contrast * (pattern - 0.5)
    mixed = shade[..., None] * (ink - paper)  # in place from here on: most of a scene's time goes into tiles
    mixed += paper
    stains *= 0.07 * contrast
    mixed += stains
    return np.asarray(np.clip(mixed, 0.02, 0.98, out=mixed))


def _cloud(rng: Generator) -> Array:
    return 0.5 + 0.5 * _noise(rng, (9, 18, 36, 72, 120))


def _grain(rng: Generator) -> Array:
    return 0.5 + 0.6 * _noise(rng, (48, 96, 144))


def _paint(rng: Generator) -> Array:
    return 0.5 + 0.10 * _noise(rng, (4, 9)) + 0.025 * _noise(rng, (72, 144))


def _print(rng: Generator) -> Array:
    sheet = np.full((TILE, TILE), rng.uniform(0.2, 0.8))
    for _ in range(110):
        # From beyond the edge, so that patches are cut there as anywhere.
        x, y = rng.integers(-20, TILE, size=2)
        w, h = rng.integers(6, 48, size=2)
        sheet[max(y, 0) : y + h, max(x, 0) : x + w] = rng.uniform(0.0, 1.0)
    return _soft(sheet) + 0.06 * _noise(rng, (72, 144))


def _stripes(rng: Generator) -> Array:
    period = rng.uniform(7.0, 16.0)
    wave = np.sin(np.arange(TILE) * 2.0 * np.pi / period + rng.uniform(0.0, 6.0))
    line = np.broadcast_to(0.5 + 0.45 * np.tanh(2.0 * wave), (TILE, TILE))
    return line + 0.08 * _noise(rng, (9, 36, 96))


def _bricks(rng: Generator) -> Array:
    high, wide = rng.uniform(8.0, 14.0), rng.uniform(16.0, 30.0)
    y, x = np.mgrid[0:TILE, 0:TILE].astype(np.float64)
    shift = np.mod(np.floor(y / high), 2.0) * wide / 2
    mortar = (np.mod(y, high) < 2.0) | (np.mod(x + shift, wide) < 2.0)
    return _soft(np.where(mortar, 0.1, 0.75)) + 0.12 * _noise(rng, (18, 36, 96))


def _checks(rng: Generator) -> Array:
    side = rng.uniform(6.0, 13.0)
    y, x = np.mgrid[0:TILE, 0:TILE].astype(np.float64)
    odd = np.mod(np.floor(x / side) + np.floor(y / side), 2.0)
    return _soft(0.15 + 0.7 * odd) + 0.08 * _noise(rng, (9, 36, 96))


KINDS: dict[str, Callable[[Generator], Array]] = {
    "cloud": _cloud,
    "grain": _grain,
    "paint": _paint,
    "print": _print,
    "stripes": _stripes,
    "bricks": _bricks,
    "checks": _checks,
}
"""Texture kind -> its pattern (TILE, TILE), about 0..1. ``paint`` is nearly plain; the last three repeat."""


def _noise(rng: Generator, nodes: tuple[int, ...]) -> Array:
    """Fractal value noise (TILE, TILE), about -1..1: one smooth random grid per count of nodes."""
    total = np.zeros((TILE, TILE))
    for count in nodes:
        grid = rng.uniform(-1.0, 1.0, size=(count, count))
        total += cv2.resize(grid, (TILE, TILE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(total / np.sqrt(len(nodes)), dtype=np.float64)


def _soft(pattern: Array) -> Array:
    return np.asarray(cv2.GaussianBlur(pattern, (0, 0), 0.8), dtype=np.float64)


def _two_colours(rng: Generator) -> tuple[Array, Array]:
    """Two colours whose brightness differs by at least 0.25, so that a pattern can be seen in grey too."""
    # At least a quarter apart in lightness, so that grey images have the pattern, too.
    light = rng.uniform(0.45, 0.95)
    dark = rng.uniform(0.05, light - 0.25)
    hues = rng.normal(0.0, 0.08, size=(2, 3))
    # Less their mean: hue must not change how light either is.
    pair = np.array([[dark], [light]]) + hues - hues.mean(axis=1, keepdims=True)
    first = int(rng.integers(2))
    return pair[first], pair[1 - first]


def _sample(texture: Array, u: Array, v: Array) -> Array:
    """Bilinear colours (N, 3) of a mirrored tile at texel coordinates u (columns) and v (rows)."""
    i, s = _cell(u, texture.shape[1])
    j, t = _cell(v, texture.shape[0])
    # Flat indices: gathering by two index arrays takes longer.
    flat = texture.reshape(-1, 3)
    at = j * texture.shape[1] + i
    top = flat[at] * (1.0 - s) + flat[at + 1] * s
    below = at + texture.shape[1]
    bottom = flat[below] * (1.0 - s) + flat[below + 1] * s
    return np.asarray(top * (1.0 - t) + bottom * t, dtype=np.float64)


def _cell(u: Array, size: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], Array]:
    """The texel left of each mirrored coordinate, and the fraction beyond it (N, 1)."""
    span = size - 1
    # Mirrored at its ends: a tile that repeats would have seams.
    folded = span - np.abs(np.mod(u, 2.0 * span) - span)
    cell = np.minimum(folded.astype(np.intp), span - 1)
    return cell, (folded - cell)[:, None]
