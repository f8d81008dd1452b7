"""Where marks and ticks go that plotly does not place by itself."""

from __future__ import annotations

import math
from collections.abc import Iterable

FAILED_NAME = "failed (no score)"


def beyond(scores: Iterable[float]) -> float:
    """Where to mark what has no score: past the worst finite one, so that it is not read as one."""
    finite = [score for score in scores if math.isfinite(score)]
    if not finite:
        return 1.0
    # Scores that are all equal have no span, and zeros no size.
    span = max(finite) - min(finite) or abs(max(finite)) or 1.0
    return max(finite) + 0.06 * span


def whole_ticks(first: int, last: int, most: int = 8) -> list[int]:
    """At most ``most`` whole numbers from ``first`` on, evenly apart, none above ``last``."""
    return list(range(first, last + 1, max(1, -(-(last - first + 1) // most))))


def log_ticks(values: Iterable[float]) -> list[float]:
    """1, 2 and 5 times powers of ten around the positive values; round numbers evenly apart where that gives
    too few.
    """
    positive = [value for value in values if 0.0 < value < math.inf]
    if not positive:
        return []
    # A little wider than the values, so that no dot lies on the edge.
    low, high = min(positive) * 0.8, max(positive) * 1.25
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = (digit * 10.0**decade for decade in decades for digit in (1, 2, 5))
    round_ones = [tick for tick in ticks if low <= tick <= high]
    return round_ones if len(round_ones) > 1 else round_ticks(low, high)


def round_ticks(low: float, high: float, most: int = 5) -> list[float]:
    """At most ``most`` numbers between two ends, 1, 2 or 5 times a power of ten apart."""
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    step = next(digit * power for digit in (1, 2, 5, 10, 20) if (high - low) / (digit * power) <= most - 1)
    # A hair of room, so that an end that is a tick itself counts in spite of rounding.
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{number * step:.12g}") for number in range(first, last + 1)]
