"""Two passes for large images: the disparity of a smaller copy starts the recurrence at full size.

The authors recommend it for images of more than about 1000 pixels; steps and padding are theirs.
"""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor

from sfkit.architectures.foundation_stereo.builder import INPUTS
from sfkit.architectures.foundation_stereo.dense_head import resize_corners
from sfkit.architectures.foundation_stereo.network import FoundationStereo
from sfkit.architectures.foundation_stereo.upsampling import FACTOR
from sfkit.architectures.inputs import Window
from sfkit.errors import InputError


def hierarchical_disparity(
    network: FoundationStereo, left: Tensor, right: Tensor, *, ratio: float = 0.5
) -> Tensor:
    """Disparity from two passes, coarse then full size.

    Args:
        network: runs its number of iterations in either pass.
        left: RGB images of 0..255, float, (B, 3, H, W) of any size; padding happens inside.
        right: the right images of the rectified pairs, same shape.
        ratio: size of the smaller copy, in (0, 1).

    Returns:
        (B, H, W) float32, in pixels.

    Raises:
        InputError: a ratio outside (0, 1).
    """
    if not 0 < ratio < 1:
        raise InputError(f"ratio is {ratio}, expected a number between 0 and 1: choose for instance 0.5")
    small = [
        F.interpolate(x, scale_factor=ratio, mode="bilinear", align_corners=False) for x in (left, right)
    ]
    (small_left, window), (small_right, _) = _padded(small[0]), _padded(small[1])
    coarse = window.crop(network(small_left, small_right))[:, None]
    height, width = left.shape[-2:]
    coarse = (resize_corners(coarse, (height, width)) / ratio).clamp(min=0)
    full_left, window = _padded(left)
    start, _ = _padded(coarse)
    # The authors add the padding on the left to the disparity; kept, so that results agree with theirs.
    start = start + window.left
    initial = resize_corners(start, (start.shape[-2] // FACTOR, start.shape[-1] // FACTOR)) / FACTOR
    disparity: Tensor = network(full_left, _padded(right)[0], initial=initial)
    return window.crop(disparity)


def _padded(x: Tensor) -> tuple[Tensor, Window]:
    window, size = INPUTS.window(*x.shape[-2:])
    return window.pad(x, size), window
