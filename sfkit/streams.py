"""The streams of random numbers: one seed serves a whole run, and each method draws its own.

Results are reproducible by these numbers: a new method takes a new one, and none ever changes.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


class Stream(IntEnum):
    """Who draws.

    ``HOLDOUT`` and ``RANDOM_SUBSETS`` are one stream: both had 3 before streams had names, and results that
    are recorded rest on it. They never meet in one method.
    """

    SUBSET_SEARCH = 1
    ROUTING_SEARCH = 2
    HOLDOUT = 3
    RANDOM_SUBSETS = 3
    BAYESIAN_SUBSETS = 4
    BAYESIAN_ROUTING = 5
    BOOTSTRAP_AVERAGE = 11
    TRAINING_ORDER = 40
    TRAINING_CHANGES = 41
    TRUST = 60


def generator(seed: int, stream: Stream, *numbers: int) -> np.random.Generator:
    """A fresh generator for one part of a method's work, whatever was drawn before.

    Args:
        seed: the run's, at least 0.
        stream: who draws.
        numbers: which part, such as a generation or an iteration.
    """
    import numpy as np  # --help draws nothing

    return np.random.default_rng([seed, int(stream), *numbers])
