"""Crops, colour jitter and erasing of the right view, as RAFT-Stereo does them (Lipson et al., 3DV 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sfkit.datasets import Sample
from sfkit.errors import InputError
from sfkit.training.settings import Augmentation

Image = NDArray[np.uint8]
BOX = (50, 100)  # px, smallest and largest side of an erased box
BOXES = 2
# Red, green and blue in the luma of ITU-R BT.601.
LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)


@dataclass(frozen=True)
class Example:
    """Two (h, w, 3) RGB uint8 views, and truth (h, w) float32 px, NaN where it is unknown."""

    left: Image
    right: Image
    truth: NDArray[np.float32]


def augment(sample: Sample, how: Augmentation, multiple: int, rng: Generator) -> Example:
    """A pair as one epoch shows it; every draw comes from ``rng``, and all are made whatever applies.

    The crop has height and width divisible by ``multiple``.

    Raises:
        InputError: the image is smaller than ``multiple``.
    """
    rows, columns = _window(sample, how.crop, multiple, rng)
    left, right = sample.left[rows, columns], sample.right[rows, columns]
    jitter = rng.random() < how.asymmetric
    # Both are drawn in any case: what follows must not hang on the jitter.
    first, second = _colours(how, rng), _colours(how, rng)
    left, right = _recolour(left, *first), _recolour(right, *(second if jitter else first))
    if rng.random() < how.erase:
        right = _erase(right, rng)
    return Example(left, right, np.ascontiguousarray(sample.disparity[rows, columns]))


def _window(
    sample: Sample, crop: tuple[int, int] | None, multiple: int, rng: Generator
) -> tuple[slice, slice]:
    found, slices = sample.size, []
    for size, wanted in zip(found, crop or found, strict=True):
        length = min(size, wanted) // multiple * multiple
        if length == 0:
            raise InputError(
                f"{sample.id}: found {found[1]}x{found[0]} pixels and crops of {crop}, expected at least "
                f"{multiple} each way: the network works on multiples of it"
            )
        # Drawn where there is no choice, too: what follows must not hang on the image's size.
        start = int(rng.integers(size - length + 1))
        slices.append(slice(start, start + length))
    return slices[0], slices[1]


def _colours(how: Augmentation, rng: Generator) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Factors of brightness, contrast and saturation, the turn of the hue, and the order they apply in."""
    reach = np.array([how.brightness, how.contrast, how.saturation, how.hue])
    return np.array([1.0, 1.0, 1.0, 0.0]) + reach * rng.uniform(-1.0, 1.0, size=4), rng.permutation(4)


def _recolour(image: Image, amounts: NDArray[np.float64], order: NDArray[np.intp]) -> Image:
    # Left as it is: not even rounding touches it.
    if np.array_equal(amounts, (1.0, 1.0, 1.0, 0.0)):
        return image
    pixels = image.astype(np.float32)
    for kind in order:
        amount = np.float32(amounts[kind])
        if kind == 0:
            pixels = pixels * amount
        elif kind == 1:
            # Contrast, about the mean grey.
            pixels = _towards((pixels @ LUMA).mean(), pixels, amount)
        elif kind == 2:
            # Saturation, about each pixel's own grey.
            pixels = _towards((pixels @ LUMA)[..., None], pixels, amount)
        else:
            pixels = _turn(pixels, float(amount))
        pixels = np.clip(pixels, 0.0, 255.0)
    return np.rint(pixels).astype(np.uint8)


def _towards(
    grey: NDArray[np.float32] | np.float32, pixels: NDArray[np.float32], amount: np.float32
) -> NDArray[np.float32]:
    return np.asarray(grey + amount * (pixels - grey), dtype=np.float32)


def _turn(pixels: NDArray[np.float32], share: float) -> NDArray[np.float32]:
    # OpenCV takes floats from 0 to 1 and gives hues of 0 to 360; whole bytes would round each turn.
    hsv = cv2.cvtColor(pixels / 255.0, cv2.COLOR_RGB2HSV)
    hsv[..., 0] = np.mod(hsv[..., 0] + 360.0 * share, 360.0)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB) * 255.0, dtype=np.float32)


def _erase(right: Image, rng: Generator) -> Image:
    """One or two boxes of the right view's mean colour: what the left view sees has no partner there."""
    painted, mean = right.copy(), right.reshape(-1, 3).mean(axis=0)
    for _ in range(int(rng.integers(1, BOXES + 1))):
        y, x = (int(rng.integers(size)) for size in right.shape[:2])
        height, width = rng.integers(*BOX, size=2)
        painted[y : y + height, x : x + width] = np.rint(mean)
    return painted
