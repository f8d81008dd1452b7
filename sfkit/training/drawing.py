"""Which pairs a step sees, and every random number about them: functions of seed, epoch and pair alone.

Nothing depends on worker, process or history, so a resumed or differently parallel training sees the same.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sfkit.streams import Stream, generator


def draw(seed: int, position: int, pairs: int) -> tuple[int, int]:
    """(epoch, index) of the pair at ``position`` of the stream of epochs, each in an order of its own."""
    epoch, within = divmod(position, pairs)
    return epoch, int(_order(seed, epoch, pairs)[within])


def successor(seed: int, position: int, pairs: int, tried: int) -> tuple[int, int]:
    """In the place of a pair that cannot be read: the ``tried``-th next one of the epoch's order."""
    epoch, within = divmod(position, pairs)
    return epoch, int(_order(seed, epoch, pairs)[(within + tried) % pairs])


def changes(seed: int, epoch: int, index: int) -> Generator:
    """The generator of crop, colours and boxes of a pair in an epoch."""
    return generator(seed, Stream.TRAINING_CHANGES, epoch, index)


@lru_cache(maxsize=4)
def _order(seed: int, epoch: int, pairs: int) -> NDArray[np.intp]:
    return generator(seed, Stream.TRAINING_ORDER, epoch).permutation(pairs)
