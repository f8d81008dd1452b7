"""The one-cycle schedule as a function of the step: nothing is carried along.

Smith and Topin, "Super-convergence" (2018), in the two-phase cosine form of PyTorch's ``OneCycleLR``, but
with a peak for each parameter group: given one number, ``OneCycleLR`` raises every group to it.
"""

from __future__ import annotations

import math

START, END = 1 / 25, 1 / 25 / 1e4
"""The first and the last rate as shares of the peak."""


def one_cycle(step: int, steps: int, peak: float, warm_up: float) -> float:
    """The rate of ``step`` (from 0) of ``steps``: up to ``peak`` after the share ``warm_up``, then down."""
    top, last = warm_up * steps - 1, steps - 1
    if step <= top:
        return _between(peak * START, peak, step / top if top > 0 else 1.0)
    return _between(peak, peak * END, (step - max(top, 0)) / max(last - max(top, 0), 1e-9))


def _between(start: float, end: float, share: float) -> float:
    return end + (start - end) * (1 + math.cos(math.pi * min(share, 1.0))) / 2
