"""Convex upsampling: every full-resolution disparity is a weighted mean of nine coarse ones (section 3.3)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.layers import ConvUnit, UpsampleFuse
from sfkit.architectures.foundation_stereo.update import MASK_CHANNELS

FACTOR = 4
NEIGHBOURS = 9
STEM_CHANNELS = 32  # of the left image's features at half resolution


def mask_fusion() -> UpsampleFuse:
    """Mask (B, 32, h, w) and half-resolution features (B, 32, 2h, 2w) -> (B, 64, 2h, 2w)."""
    both = MASK_CHANNELS + STEM_CHANNELS
    up = nn.ConvTranspose2d(MASK_CHANNELS, MASK_CHANNELS, 4, stride=2, padding=1, bias=False)
    return UpsampleFuse(ConvUnit(up), ConvUnit(nn.Conv2d(both, both, 3, padding=1, bias=False)))


def weight_logits() -> nn.Sequential:
    """(B, 64, 2h, 2w) -> nine logits a pixel, (B, 9, 4h, 4w)."""
    both = MASK_CHANNELS + STEM_CHANNELS
    return nn.Sequential(nn.ConvTranspose2d(both, NEIGHBOURS, 4, stride=2, padding=1))


def convex_upsample(disparity: Tensor, logits: Tensor) -> Tensor:
    """Blend each coarse pixel's 3 x 3 neighbourhood (zero outside the image) by softmax weights.

    Args:
        disparity: (B, 1, h, w) in quarter-resolution pixels.
        logits: (B, 9, 4h, 4w), one weight a neighbour, row by row.

    Returns:
        (B, 1, 4h, 4w) in full-resolution pixels, float32.
    """
    height, width = disparity.shape[-2:]
    with torch.autocast(disparity.device.type, enabled=False):
        # Four pixels of the image to one of the map: disparities grow alike.
        taps = F.unfold(FACTOR * disparity.float(), 3, padding=1)
        taps = taps.view(-1, NEIGHBOURS, height, 1, width, 1)
        weights = logits.float().softmax(dim=1)
        weights = weights.view(-1, NEIGHBOURS, height, FACTOR, width, FACTOR)
        return (weights * taps).sum(dim=1).view(-1, 1, FACTOR * height, FACTOR * width)
