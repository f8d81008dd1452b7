"""Features of both images at four resolutions: the fusion neck between the backbones and the cost volume.

Paper section 3.1: the convolutional features of EdgeNeXt are fused coarse to fine, and the monocular
features join them at a quarter of the resolution.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.edgenext import WIDTHS, edgenext_stages, edgenext_stem
from sfkit.architectures.foundation_stereo.layers import (
    ConvUnit,
    PlainResidual,
    RectifiedResidual,
    UpsampleFuse,
)
from sfkit.architectures.foundation_stereo.monocular import MonocularBranch
from sfkit.architectures.foundation_stereo.sizes import VitSize

# channels of the fused maps at 1/4 (without the monocular features), 1/8, 1/16 and 1/32
FUSED = (2 * WIDTHS[0], 2 * WIDTHS[1], 2 * WIDTHS[2], WIDTHS[3])


class Features(NamedTuple):
    """Feature maps of a batch of images of size H x W.

    Attributes:
        quarter: (B, 96 + V, H / 4, W / 4), V the monocular channels (32, 64 or 128).
        eighth: (B, 192, H / 8, W / 8).
        sixteenth: (B, 320, H / 16, W / 16).
        thirtysecond: (B, 304, H / 32, W / 32).
        monocular: (B, V, H / 4, W / 4).
    """

    quarter: Tensor
    eighth: Tensor
    sixteenth: Tensor
    thirtysecond: Tensor
    monocular: Tensor

    def halves(self) -> tuple[Features, Features]:
        """The first and the second half of the batch: left and right images."""
        parts = [x.chunk(2) for x in self]
        return Features(*(p[0] for p in parts)), Features(*(p[1] for p in parts))


class FeatureNetwork(nn.Module):
    """Monocular branch, EdgeNeXt and fusion neck; left and right images share it."""

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        self.stem = edgenext_stem()
        self.stages = edgenext_stages()
        self.dino = MonocularBranch(size)
        self.deconv32_16 = _fusion(FUSED[3], WIDTHS[2])
        self.deconv16_8 = _fusion(FUSED[2], WIDTHS[1])
        self.deconv8_4 = _fusion(FUSED[1], WIDTHS[0])
        quarter = FUSED[0] + size.out_channels
        self.conv4 = nn.Sequential(
            ConvUnit(nn.Conv2d(quarter, quarter, 3, padding=1, bias=False), nn.InstanceNorm2d(quarter)),
            RectifiedResidual(quarter, quarter, nn.InstanceNorm2d),
            RectifiedResidual(quarter, quarter, nn.InstanceNorm2d),
        )

    def forward(self, images: Tensor) -> Features:
        """Normalised images (B, 3, H, W), H and W multiples of 32 -> their features."""
        monocular = self.dino(images)
        maps = [self.stem(images)]
        for stage in self.stages:
            maps.append(stage(maps[-1]))
        _, fine4, fine8, fine16, coarse = maps
        sixteenth = self.deconv32_16(coarse, fine16)
        eighth = self.deconv16_8(sixteenth, fine8)
        quarter = self.conv4(torch.cat([self.deconv8_4(eighth, fine4), monocular], dim=1))
        return Features(quarter, eighth, sixteenth, coarse, monocular)


def _fusion(coarse: int, fine: int) -> UpsampleFuse:
    up = nn.ConvTranspose2d(coarse, fine, 4, stride=2, padding=1, bias=False)
    return UpsampleFuse(
        ConvUnit(up, nn.InstanceNorm2d(fine)), PlainResidual(nn.Conv2d, nn.InstanceNorm2d, 2 * fine)
    )


def image_stem(c_in: int, c_out: int) -> nn.Sequential:
    """Half-resolution features: (B, c_in, H, W) -> (B, c_out, H / 2, W / 2)."""
    return nn.Sequential(
        ConvUnit(
            nn.Conv2d(c_in, c_out, 3, stride=2, padding=1, bias=False),
            nn.InstanceNorm2d(c_out),
        ),
        nn.Conv2d(c_out, c_out, 3, padding=1, bias=False),
        nn.InstanceNorm2d(c_out),
        nn.ReLU(),
    )
