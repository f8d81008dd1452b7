"""The maps of one pair as plain pictures, pixel for pixel: for files rather than for pages."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.differences import AdvantagePanels
from sfkit.colours import DISPARITY, ERROR, ERROR_SPAN, error_position, paint
from sfkit.figures.differences import ADVANTAGE_SPAN

PICTURES = ("a_disparity", "b_disparity", "a_error", "b_error", "better")
"""Of a pair: what both networks predict in one colour range, where each is wrong, and where b is nearer."""


def pair_pictures(panels: AdvantagePanels) -> dict[str, NDArray[np.uint8]]:
    """The pictures of ``PICTURES``, each (H, W, 3) RGB uint8; a is the reference, b the other network.

    Errors are blue below the threshold and orange above. ``better`` is blue where b is nearer to the ground
    truth, orange where a is. What has no value is hatched grey.
    """
    pair, span = panels.pair, ADVANTAGE_SPAN * panels.pair.threshold
    maps = {network.name: network for network in pair.networks}
    found = {}
    for letter, name in (("a", panels.reference), ("b", panels.network)):
        disparity, error = maps[name].disparity, maps[name].error
        known = np.where(np.isfinite(disparity), disparity, np.float32(np.nan))
        found[f"{letter}_disparity"] = paint(known, pair.limits, DISPARITY)
        position = np.where(np.isnan(error), np.nan, error_position(error, pair.threshold))
        found[f"{letter}_error"] = paint(position, (-ERROR_SPAN, ERROR_SPAN), ERROR)
    found["better"] = paint(panels.advantage.difference, (-span, span), ERROR)
    return {name: found[name] for name in PICTURES}
