"""The U-Net that turns an image into signed feature maps at 1/16, 1/8 and 1/4 of its size.

AnyNet (Wang et al., ICRA 2019), section III-B. Both images pass through the same weights. Module names
are those of the published checkpoints.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

WIDTH = 1  # channels at full resolution; doubled at 1/4, 1/8 and 1/16


class FeaturePyramid(NamedTuple):
    """Feature maps of B images, coarse to fine: (B, 8, H/16, W/16), (B, 4, H/8, W/8), (B, 2, H/4, W/4)."""

    sixteenth: torch.Tensor
    eighth: torch.Tensor
    quarter: torch.Tensor


class FeatureExtractor(nn.Module):
    """Image (B, 3, H, W), normalised, H and W multiples of 16 -> ``FeaturePyramid``."""

    def __init__(self) -> None:
        super().__init__()
        quarter, eighth, sixteenth = 2 * WIDTH, 4 * WIDTH, 8 * WIDTH
        self.block0 = nn.Sequential(
            nn.Sequential(nn.Conv2d(3, WIDTH, 3, padding=1), unit(WIDTH, WIDTH, stride=2)),
            _down(WIDTH, quarter),
        )
        self.blocks = nn.ModuleList([_down(quarter, eighth), _down(eighth, sixteenth)])
        self.upblocks = nn.ModuleList([Up(eighth + sixteenth, eighth), Up(quarter + eighth, quarter)])

    def forward(self, image: torch.Tensor) -> FeaturePyramid:
        # With one output channel the first convolution is up to twice as fast on this layout.
        quarter = self.block0(image.contiguous(memory_format=torch.channels_last))
        eighth = self.blocks[0](quarter)
        sixteenth = self.blocks[1](eighth)
        eighth = self.upblocks[0](eighth, sixteenth)
        return FeaturePyramid(sixteenth, eighth, self.upblocks[1](quarter, eighth))


class Up(nn.Module):
    """A fine map and the map one level coarser -> a fine map that has seen both."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        self.conv = nn.Sequential(unit(channels_in, channels_out), unit(channels_out, channels_out))

    def forward(self, fine: torch.Tensor, coarse: torch.Tensor) -> torch.Tensor:
        raised = F.interpolate(coarse, scale_factor=2, mode="bilinear", align_corners=True)
        return self.conv(torch.cat([fine, raised], dim=1))  # type: ignore[no-any-return]  # modules are untyped


def unit(channels_in: int, channels_out: int, stride: int = 1) -> nn.Sequential:
    """Batch norm and ReLU come before the convolution, so that its output keeps its sign."""
    return nn.Sequential(
        nn.BatchNorm2d(channels_in),
        nn.ReLU(inplace=True),
        nn.Conv2d(channels_in, channels_out, 3, stride=stride, padding=1, bias=False),
    )


def _down(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(nn.MaxPool2d(2), unit(channels_in, channels_out), unit(channels_out, channels_out))
