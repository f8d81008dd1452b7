"""What air and cameras do to the two views: haze, blur, exposure, grey film, noise, sparse ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sfkit.datasets.synthetic.render import Views
from sfkit.datasets.synthetic.surfaces import Array, Mask

LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class Response:
    """One view's optics and tone: blur, then 255 * (gain * radiance) ** gamma, then noise.

    ``gain`` is per RGB channel; ``blur`` is the Gaussian's sigma in pixels, 0 for none; ``noise`` the
    standard deviation in grey levels of 0..255 at mid-grey (its variance grows with the signal).
    """

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gamma: float = 1.0
    blur: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Weather:
    """Haze: a share exp(-density * 10 px / disparity) of the radiance arrives, the rest is sky ``light``."""

    density: float = 0.0
    light: tuple[float, float, float] = (0.8, 0.8, 0.8)


def photograph(
    radiance: Array, disparity: Array, weather: Weather, response: Response, grey: bool, rng: Generator
) -> NDArray[np.uint8]:
    """One view's picture (H, W, 3), uint8 RGB, from its radiance (H, W, 3) and disparity (H, W)."""
    seen = radiance
    if weather.density > 0.0:
        # Nothing is farther than 0.1 px here, by which a division by 0 is avoided.
        passed = np.exp(-weather.density * 10.0 / np.maximum(disparity, 0.1))[..., None]
        seen = seen * passed + np.asarray(weather.light) * (1.0 - passed)
    if response.blur > 0.0:
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), response.blur), dtype=np.float64)
    # Clipped before the gamma, since a negative base has no power.
    toned = np.clip(seen * np.asarray(response.gain), 0.0, 1.0) ** response.gamma
    if grey:
        toned = np.repeat((toned @ LUMA)[..., None], 3, axis=2)
    levels = 255.0 * toned
    if response.noise > 0.0:
        channels = 1 if grey else 3
        # Photons: the variance grows with the signal. At mid-grey it is that of noise, 0.3 + 1.4 / 2 = 1.
        spread = response.noise * np.sqrt(0.3 + 1.4 * toned)
        levels = levels + spread * rng.standard_normal((*toned.shape[:2], channels))
    return np.asarray(np.clip(np.rint(levels), 0.0, 255.0), dtype=np.uint8)


def ground_truth(views: Views, keep: Mask | None = None) -> NDArray[np.float32]:
    """The left disparity (H, W) float32, pixels; NaN outside ``keep`` where one is given."""
    exact = views.disparity.astype(np.float32)
    return exact if keep is None else np.where(keep, exact, np.float32(np.nan))


def scan_lines(height: int, width: int, density: float, rng: Generator) -> Mask:
    """Where a scanner measured: every third row, each pixel by chance; ``density`` of all on average."""
    mask = np.zeros((height, width), dtype=bool)
    rows = mask[int(rng.integers(3)) :: 3]
    # A third of the rows are scanned, so that each of their pixels is three times as likely.
    rows[:] = rng.random(rows.shape) < min(1.0, 3.0 * density)
    return mask
