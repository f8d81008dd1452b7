"""Which of many points are drawn, so that a live figure stays light."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

LIMIT = 400
"""Points in one trace; a figure that is redrawn eight times a second stays smooth up to about here."""


def drawn_points(count: int, keep: Iterable[int] = (), limit: int = LIMIT) -> NDArray[np.int64]:
    """At most ``limit`` of the positions 0 to count - 1, ascending: the first, the last, an even choice.

    Args:
        count: how many points there are, at least 0.
        keep: positions that matter more than others (where something changed); they are all in where
            they fill no more than half of the limit and leave room for both ends.
        limit: at least 2.
    """
    if count <= limit:
        return np.arange(count, dtype=np.int64)
    wanted = np.unique(np.fromiter(keep, dtype=np.int64))
    # Too many to keep: then none is, rather than the first ones.
    wanted = wanted if len(wanted) <= min(limit // 2, limit - 2) else wanted[:0]
    even = np.linspace(0, count - 1, limit - len(wanted)).round().astype(np.int64)
    return np.union1d(even, wanted)
