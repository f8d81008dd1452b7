"""Numbered pairs of a domain: the same number gives the same pair, whatever was rendered before."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from sfkit.datasets.synthetic.camera import Response, Weather, ground_truth, photograph, scan_lines
from sfkit.datasets.synthetic.domains import HEIGHT, WIDTH, Domain
from sfkit.datasets.synthetic.render import render
from sfkit.datasets.synthetic.scene import Composer

SEED = 2026
SPLITS = {"train": 0, "held-out": 1, "benchmark": 2}


@dataclass(frozen=True)
class SyntheticPair:
    """One rendered pair.

    Attributes:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB.
        disparity: of the left view, (H, W) float32, pixels; NaN where the domain's ground truth has none.
        nonoccluded: (H, W) bool, left pixels that the right view shows too; dense and exact.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    nonoccluded: NDArray[np.bool_]


def synthetic_pair(
    domain: Domain, index: int, *, split: str = "train", height: int = HEIGHT, width: int = WIDTH
) -> SyntheticPair:
    """Pair ``index`` of a domain's ``train``, ``held-out`` or ``benchmark`` split; splits share no scene."""
    # Python's own hash of a text differs from process to process.
    name = zlib.crc32(domain.name.encode())
    # Two generators: another camera leaves the scene as it was.
    scene_seed, camera_seed = SeedSequence([SEED, name, SPLITS[split], index]).spawn(2)
    return rendered(domain, default_rng(scene_seed), default_rng(camera_seed), height, width)


def rendered(domain: Domain, scene: Generator, camera: Generator, height: int, width: int) -> SyntheticPair:
    """A pair whose surfaces come from the generator ``scene`` and whose pictures come from ``camera``."""
    views = render(Composer(domain, height, width, scene).compose(), height, width)
    # Drawn in this order for good: another would draw another pair.
    weather = Weather(
        density=float(camera.uniform(*domain.haze)),
        light=_triple(camera.uniform(0.7, 0.9) + camera.normal(0.0, 0.02, size=3)),
    )
    grey = bool(camera.random() < domain.grey)
    brightness = float(camera.uniform(*domain.brightness))
    first = Response(
        gain=(brightness, brightness, brightness),
        blur=float(camera.uniform(*domain.blur)),
        noise=float(camera.uniform(*domain.noise)),
    )
    second = _other_response(first, domain, camera)
    scanned = bool(camera.random() < domain.scanned)
    keep = scan_lines(height, width, float(camera.uniform(*domain.scan_density)), camera) if scanned else None
    return SyntheticPair(
        left=photograph(views.left, views.disparity, weather, first, grey, camera),
        right=photograph(views.right, views.right_disparity, weather, second, grey, camera),
        disparity=ground_truth(views, keep),
        nonoccluded=views.visible,
    )


def _other_response(first: Response, domain: Domain, camera: Generator) -> Response:
    """The right camera's: its own blur, the same noise, gain and gamma off by the domain's exposure."""
    swing = domain.exposure * camera.uniform(-1.0, 1.0)
    tint = 0.25 * domain.exposure * camera.uniform(-1.0, 1.0, size=3)
    return Response(
        gain=_triple(first.gain[0] * np.exp(swing + tint)),
        gamma=float(np.exp(0.5 * domain.exposure * camera.uniform(-1.0, 1.0))),
        blur=float(camera.uniform(*domain.blur)),
        noise=first.noise,
    )


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
