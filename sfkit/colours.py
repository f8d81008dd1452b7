"""Colour maps for colour-blind eyes, and how maps of pixels are painted with them."""

from __future__ import annotations

import base64
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", bound=np.generic)
Stops = tuple[tuple[int, int, int], ...]

DISPARITY: Stops = (
    (68, 1, 84),
    (72, 40, 120),
    (62, 74, 137),
    (49, 104, 142),
    (38, 130, 142),
    (31, 158, 137),
    (53, 183, 121),
    (110, 206, 88),
    (181, 222, 43),
    (253, 231, 37),
)
"""Far (low) to near (high): viridis, which is even in lightness and reads without red and green."""

ERROR: Stops = (
    (11, 61, 122),
    (46, 111, 176),
    (132, 182, 222),
    (242, 242, 242),
    (247, 171, 104),
    (214, 99, 26),
    (122, 44, 0),
)
"""Right (blue) to wrong (orange), light where the error equals the threshold."""

SHARE: Stops = (
    (0, 34, 78),
    (53, 69, 108),
    (102, 105, 112),
    (149, 143, 120),
    (202, 186, 106),
    (254, 232, 56),
)
"""None (low) to all (high): cividis."""

OPPOSED: Stops = (
    (94, 60, 153),
    (140, 112, 184),
    (190, 175, 214),
    (245, 245, 245),
    (166, 214, 201),
    (92, 174, 155),
    (0, 109, 90),
)
"""Against (purple) to along (green), light at 0: neither is good or bad."""

ERROR_SPAN = 3.0
"""An error map runs from 2^-3 to 2^3 times its threshold."""

_HATCH = ((118, 118, 118), (158, 158, 158))
_HATCH_PERIOD = 8

SPARSE = 0.5
"""Of a map with values at a smaller share of its pixels, each value is painted wider, by ``REACH`` pixels."""
REACH = 3
_NEIGHBOURS = sorted(
    (
        (dy, dx)
        for dy in range(-REACH, REACH + 1)
        for dx in range(-REACH, REACH + 1)
        if 0 < dy * dy + dx * dx <= REACH * REACH
    ),
    key=lambda at: (at[0] ** 2 + at[1] ** 2, at),
)


def share_position(share: float) -> float:
    """Where a share stands on :data:`SHARE`: at its square root, so that the small ones differ, too."""
    return float(np.sqrt(min(max(share, 0.0), 1.0)))


def share_scale() -> list[list[float | str]]:
    """:data:`SHARE` as plotly writes it, with shares where :func:`share_position` puts them."""
    return [[float(at) ** 2, colour] for at, colour in plotly_scale(SHARE)]


def plotly_scale(stops: Stops) -> list[list[float | str]]:
    """The colour map as plotly writes it."""
    last = len(stops) - 1
    return [[i / last, f"rgb({r},{g},{b})"] for i, (r, g, b) in enumerate(stops)]


def lookup(stops: Stops) -> NDArray[np.uint8]:
    """The colour map as (256, 3) RGB uint8."""
    at = np.linspace(0.0, len(stops) - 1.0, 256)
    channels = [np.interp(at, np.arange(len(stops)), channel) for channel in zip(*stops, strict=True)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


def colour_at(stops: Stops, position: float) -> tuple[int, int, int]:
    """The RGB colour at ``position`` in [0, 1]."""
    red, green, blue = lookup(stops)[round(255 * min(max(position, 0.0), 1.0))]
    return int(red), int(green), int(blue)


def text_on(colour: tuple[int, int, int]) -> str:
    """Black or white, whichever reads better on an RGB colour (WCAG contrast)."""
    red, green, blue = (_linear(value / 255.0) for value in colour)
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    # Contrasts to white, 1.05 / (L + 0.05), and to black, (L + 0.05) / 0.05, compared without a division.
    return "#000000" if (luminance + 0.05) ** 2 > 0.05 * 1.05 else "#ffffff"


def error_position(error: NDArray[np.floating], threshold: float) -> NDArray[np.float64]:
    """Errors in pixels on the log2 scale of :data:`ERROR`: 0 at the threshold, clipped to its ends."""
    # An error of 0 has no logarithm: it stands at the low end.
    ratio = np.maximum(np.asarray(error, dtype=np.float64) / threshold, 2.0**-ERROR_SPAN)
    return np.asarray(np.clip(np.log2(ratio), -ERROR_SPAN, ERROR_SPAN))


def paint(values: NDArray[np.floating], limits: tuple[float, float], stops: Stops) -> NDArray[np.uint8]:
    """A map (H, W) as RGB uint8 (H, W, 3).

    Values beyond the limits take the colours of the ends; NaN, which is no value, is a grey hatch that no
    colour map has, and never the colour of 0. Where values are sparse, as a laser scanner measures them,
    pixels up to ``REACH`` away look like the nearest: a dot a pixel wide between stripes cannot be seen.
    """
    low, high = limits
    known = ~np.isnan(values)
    # Half a level is added for truncation to round; the low end stands in for NaN, whose cast is undefined.
    levels = np.clip((np.where(known, values, low) - low) * (255.0 / (high - low)) + 0.5, 0, 255)
    # OpenCV looks colours up in a tenth of NumPy's time, which widgets need to follow a drag.
    painted = np.asarray(cv2.applyColorMap(levels.astype(np.uint8), _table(stops)), dtype=np.uint8)
    missing = (~known).astype(np.uint8)
    if is_sparse(known):
        missing = _widened(painted, missing)
    cv2.copyTo(_hatch(*values.shape), missing, painted)
    return painted


def is_sparse(known: NDArray[np.bool_]) -> bool:
    """Whether so few pixels of a map have a value that each is painted wider."""
    return bool(0 < np.count_nonzero(known) < SPARSE * known.size)


def _widened(painted: NDArray[np.uint8], missing: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give pixels near a value the colour of the nearest, in place; where there is none even then."""
    height, width = missing.shape
    borders = (REACH, REACH, REACH, REACH, cv2.BORDER_CONSTANT)
    colours = cv2.copyMakeBorder(painted, *borders)
    known = np.asarray(cv2.copyMakeBorder(1 - missing, *borders), dtype=np.uint8)
    # One neighbour after the other, the nearest first: a fifth of the time that a distance transform takes.
    for dy, dx in _NEIGHBOURS:
        rows, columns = slice(REACH + dy, REACH + dy + height), slice(REACH + dx, REACH + dx + width)
        taken = missing & known[rows, columns]
        cv2.copyTo(colours[rows, columns], taken, painted)
        missing = missing - taken
    return missing


def painted_disparity(disparity: NDArray[np.floating], limits: tuple[float, float]) -> NDArray[np.uint8]:
    """A disparity map (H, W) in pixels as RGB uint8 (H, W, 3); what is not finite is hatched."""
    return paint(np.where(np.isfinite(disparity), disparity, np.float32(np.nan)), limits, DISPARITY)


def painted_error(error: NDArray[np.floating], threshold: float) -> NDArray[np.uint8]:
    """An error or residual map (H, W) likewise: blue below the threshold, orange beyond; NaN is hatched."""
    position = np.where(np.isnan(error), np.nan, error_position(error, threshold))
    return paint(position, (-ERROR_SPAN, ERROR_SPAN), ERROR)


@lru_cache(maxsize=8)
def _table(stops: Stops) -> NDArray[np.uint8]:
    """A colour map as OpenCV wants it: (256, 1, 3), in the order its results shall have."""
    return np.ascontiguousarray(lookup(stops)[:, None])


# Kept: a widget paints one size again and again.
_hatch = lru_cache(maxsize=8)(lambda height, width: hatch(height, width))


def hatch(height: int, width: int) -> NDArray[np.uint8]:
    """(H, W, 3) RGB uint8 of diagonal grey stripes: no value here."""
    rows, columns = np.indices((height, width))
    stripe = (rows + columns) % _HATCH_PERIOD < _HATCH_PERIOD // 2
    dark, light = (np.array(colour, np.uint8) for colour in _HATCH)
    return np.ascontiguousarray(np.where(stripe[..., None], dark, light))


def range_of(values: NDArray[np.floating]) -> tuple[float, float]:
    """A colour range: the 1st and 99th percentile of the finite values, at least a little apart."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, (1, 99)) if finite.size else (0.0, 1.0)
    return float(low), float(max(high, low + 1e-6))


def picked(values: NDArray[Value], longest: int) -> NDArray[Value]:
    """Every k-th pixel of a map (H, W), so that its longest side has at most ``longest`` pixels.

    Pixels are picked, not averaged: invalid ones would otherwise bleed into their neighbours.
    """
    # Rounded up: rounded down, a side of 2 k - 1 pixels would stay as it is.
    step = -(-max(values.shape) // longest)
    return values[::step, ::step]


def shrunk(image: NDArray[np.uint8], longest: int) -> NDArray[np.uint8]:
    """An RGB photograph (H, W, 3), averaged down so that its longest side has at most ``longest`` pixels."""
    step = -(-max(image.shape[:2]) // longest)
    size = (-(-image.shape[1] // step), -(-image.shape[0] // step))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def embedded(image: NDArray[np.uint8], *, photograph: bool = False) -> str:
    """An RGB image (H, W, 3) as a data URI: PNG, or JPEG for photographs."""
    suffix, options = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 88]) if photograph else (".png", [])
    # OpenCV takes blue first.
    done, data = cv2.imencode(suffix, np.ascontiguousarray(image[..., ::-1]), options)
    if not done:
        raise ValueError(f"an image of {image.shape} cannot be coded as {suffix}")
    kind = "jpeg" if photograph else "png"
    return f"data:image/{kind};base64,{base64.b64encode(np.asarray(data).tobytes()).decode()}"


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else float(((value + 0.055) / 1.055) ** 2.4)
