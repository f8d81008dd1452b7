"""The k-th largest magnitude of many numbers, in two passes and without sorting or copying them.

A sample brackets the value; one pass counts what lies above the bracket and keeps what lies inside, less than
a hundredth of all; among those the value is found exactly. The sample is evenly spread and drawn from
nothing, so that the same numbers always take the same way, and it never changes the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
import torch

SAMPLE = 1 << 18
# Standard deviations of the sample's quantile on either side of it. Once in 2000 times the value lies
# outside, which costs one more pass; a wider bracket costs more every time.
SPREAD = 3.5

Chunks = Callable[[], Iterable[torch.Tensor]]
"""Reads the numbers from the beginning, chunk by chunk."""


def kth_magnitude(chunks: Chunks, count: int, k: int) -> float:
    """The k-th largest absolute value.

    Args:
        chunks: float32 tensors of shape (n,), ``count`` numbers in all; asked for two or three times.
        count: how many numbers there are, at least 1.
        k: from 1 to ``count``.
    """
    low, high = _bracket(chunks, count, k)
    while True:
        above, inside = _inspect(chunks, low, high)
        if above >= k:  # the sample was unlucky: the value lies above its bracket
            low, high = high, math.inf
        elif above + inside.count < k:
            low, high = 0.0, low
        else:
            return inside.largest(k - above)


class _Inside:
    """The magnitudes inside a bracket; of a bracket of one value only their number."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high
        self.count = 0
        self._kept: list[np.ndarray] = []

    def add(self, magnitudes: np.ndarray, inside: np.ndarray) -> None:
        if self.low == self.high:
            self.count += int(np.count_nonzero(inside))
            return
        kept = magnitudes[inside]
        self.count += kept.size
        self._kept.append(kept)

    def largest(self, k: int) -> float:
        """The k-th largest of them."""
        if self.low == self.high:
            return self.low
        every = np.concatenate(self._kept)
        place = every.size - k
        # One place is sorted, all others are only parted by it.
        every.partition(place)
        return float(every[place])


def _inspect(chunks: Chunks, low: float, high: float) -> tuple[int, _Inside]:
    """How many magnitudes lie above the bracket, and those inside it.

    Compared, counted and indexed by numpy, which has vector instructions for that where torch takes 5 to 10
    times as long, and in buffers that stay in the cache.
    """
    inside, above = _Inside(low, high), 0
    # In the values' own type, so that comparing widens none of them.
    least, most = np.float32(low), np.float32(high)
    room, flags = np.empty(0, np.float32), np.empty((2, 0), np.bool_)
    for chunk in chunks():
        values = chunk.numpy()
        if values.size > room.size:
            room, flags = np.empty(values.size, np.float32), np.empty((2, values.size), np.bool_)
        magnitudes, higher, within = room[: values.size], *flags[:, : values.size]
        np.abs(values, out=magnitudes)
        np.greater(magnitudes, most, out=higher)
        np.greater_equal(magnitudes, least, out=within)
        np.not_equal(within, higher, out=within)
        above += int(np.count_nonzero(higher))
        inside.add(magnitudes, within)
    return above, inside


def _bracket(chunks: Chunks, count: int, k: int) -> tuple[float, float]:
    """Two sampled magnitudes with the k-th largest most likely between them."""
    # At regular steps: a sample without a draw, the same on every run.
    stride = max(1, count // SAMPLE)
    sample = np.concatenate([chunk.numpy()[::stride] for chunk in chunks()])
    np.abs(sample, out=sample)
    share, drawn = k / count, sample.size
    spread = SPREAD * math.sqrt(share * (1.0 - share) * drawn) + 2.0
    # Places in ascending order of what lies so far above and below the wanted share.
    most = drawn - 1 - math.floor(share * drawn - spread)
    least = drawn - 1 - math.ceil(share * drawn + spread)
    sample.partition([min(max(place, 0), drawn - 1) for place in (least, most)])
    low = float(sample[least]) if least >= 0 else 0.0
    high = float(sample[most]) if most < drawn else math.inf
    return low, high
