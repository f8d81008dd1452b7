"""Small stereo pairs written to disk, for the tests of the readers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray


@dataclass(frozen=True)
class Views:
    """A textured pair whose right view is the left one moved by a constant disparity."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    disparity: NDArray[np.float32]


def make_views(height: int = 40, width: int = 64, shift: int = 6, seed: int = 0) -> Views:
    """Smooth random texture; left (x, y) is seen at (x - shift, y) in the right view."""
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width + shift, 3)).astype(np.float32)
    scene = cv2.GaussianBlur(noise, (0, 0), 1.5)
    scene = ((scene - scene.min()) / np.ptp(scene) * 255).astype(np.uint8)
    disparity = np.full((height, width), shift, np.float32)
    return Views(scene[:, :width].copy(), scene[:, shift:].copy(), disparity)


def write_png(path: Path, rgb_or_grey: NDArray[np.generic]) -> Path:
    """Write RGB (H, W, 3) or grey (H, W) with OpenCV, making the folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = rgb_or_grey[:, :, ::-1] if rgb_or_grey.ndim == 3 else rgb_or_grey
    assert cv2.imwrite(str(path), np.ascontiguousarray(pixels))
    return path


def write_pfm_by_hand(path: Path, disparity: NDArray[np.float32]) -> Path:
    """A PFM written without the library: header, then rows from the bottom up."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = disparity.shape
    rows = b"".join(disparity[row].astype("<f4").tobytes() for row in range(height - 1, -1, -1))
    path.write_bytes(b"Pf\n%d %d\n-1.0\n" % (width, height) + rows)
    return path


@pytest.fixture
def views() -> Views:
    """One textured pair with disparity 6."""
    return make_views()


@pytest.fixture
def png() -> Callable[[Path, NDArray[np.generic]], Path]:
    """The PNG writer."""
    return write_png


@pytest.fixture
def eth3d_root(tmp_path: Path) -> Path:
    """Two ETH3D pairs in the official layout, with masks and calibration."""
    for number, name in enumerate(("forest_1s", "terrace_1s")):
        pair = make_views(seed=number)
        folder, truth = tmp_path / "two_view_training" / name, tmp_path / "two_view_training_gt" / name
        write_png(folder / "im0.png", pair.left)
        write_png(folder / "im1.png", pair.right)
        (folder / "calib.txt").write_text("cam0=[500 0 1; 0 500 1; 0 0 1]\ndoffs=2\nbaseline=60\n")
        disparity = pair.disparity.copy()
        disparity[0, :] = np.inf
        write_pfm_by_hand(truth / "disp0GT.pfm", disparity)
        mask = np.full(disparity.shape, 255, np.uint8)
        mask[:, :6] = 128
        mask[0, :] = 0
        write_png(truth / "mask0nocc.png", mask)
    return tmp_path
