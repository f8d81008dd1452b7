"""Colour maps as people without one kind of cone see them: order and sides stay readable.

Machado, Oliveira and Fernandes, "A Physiologically-based Model for Simulation of Color Vision Deficiency",
2009: their matrices for full deficiency, in linear RGB.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.colours import DISPARITY, ERROR, SHARE, Stops, lookup

SEEN = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
JUST_NOTICED = 2.3  # distance in CIELAB


def seen(stops: Stops, kind: str) -> NDArray[np.float32]:
    """(256, 3) CIELAB values of a colour map as it is seen."""
    colours = lookup(stops) / 255.0
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    light = np.clip(linear @ np.array(SEEN[kind]).T, 0.0, 1.0)
    shown = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(cv2.cvtColor(shown[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0], np.float32)


@pytest.mark.parametrize("kind", SEEN)
@pytest.mark.parametrize("stops", [DISPARITY, SHARE], ids=["disparity", "share"])
def test_low_and_high_keep_their_order(stops: Stops, kind: str) -> None:
    lightness = seen(stops, kind)[:, 0]
    assert (np.diff(lightness[::5]) > 0).all()  # neighbours can differ by rounding alone
    assert lightness[-1] - lightness[0] > 20 * JUST_NOTICED


@pytest.mark.parametrize("kind", SEEN)
def test_right_and_wrong_are_never_confused(kind: str) -> None:
    colours = seen(ERROR, kind)
    # An octave and more from the threshold; each right colour beside every wrong one.
    right, wrong = colours[: 256 // 3, None], colours[None, -(256 // 3) :]
    assert np.linalg.norm(right - wrong, axis=-1).min() > 5 * JUST_NOTICED
