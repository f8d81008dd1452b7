"""The two image encoders: Swin-T with a deformable neck, and convolutions with instance norm.

Instance norm here has neither parameters nor running statistics, so it owns no keys and acts the
same in training and evaluation.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf.neck import DeformableNeck
from sfkit.architectures.nmrf.swin import WIDTHS, SwinBackbone

# ImageNet's statistics in grey levels of 0..255, RGB.
MEAN = (123.675, 116.28, 103.53)
STD = (58.395, 57.12, 57.375)


class SwinEncoder(nn.Module):
    """Images -> one feature map at 1/4 resolution.

    With ``normalise`` the images are RGB of 0..255 and are normalised here with the buffers ``mean``
    and ``std``; without it the caller has normalised them (the buffers stay, for the files' sake).
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, features: int, normalise: bool, drop_path: float) -> None:
        super().__init__()
        self.normalise = normalise
        self.register_buffer("mean", torch.tensor(MEAN).reshape(1, 3, 1, 1))
        self.register_buffer("std", torch.tensor(STD).reshape(1, 3, 1, 1))
        self.backbone = SwinBackbone(drop_path)
        self.neck = DeformableNeck(WIDTHS, features)

    def forward(self, images: torch.Tensor, rng: np.random.Generator | None = None) -> torch.Tensor:
        """(B, 3, H, W), H and W multiples of 32 -> (B, features, H/4, W/4)."""
        x = (images - self.mean) / self.std if self.normalise else images
        y: torch.Tensor = self.neck(x, self.backbone(x, rng))
        return y


STEM_WIDTH = 64
LAYER_WIDTHS = (64, 96, 128)
LAYER_STRIDES = (1, 2, 1)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions and a skip; ReLU also before the addition."""

    def __init__(self, c_in: int, c_out: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(c_in, c_out, 3, stride=stride, padding=1, bias=False)
        self.conv2 = nn.Conv2d(c_out, c_out, 3, padding=1, bias=False)
        changes = stride != 1 or c_in != c_out
        self.downsample = (
            nn.Sequential(nn.Conv2d(c_in, c_out, 1, stride=stride), nn.InstanceNorm2d(c_out))
            if changes
            else nn.Identity()
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, c_in, h, w) -> (B, c_out, h / stride, w / stride)."""
        y = F.relu(F.instance_norm(self.conv1(x)))
        y = F.relu(F.instance_norm(self.conv2(y)))
        return F.relu(self.downsample(x) + y)


class ResidualEncoder(nn.Module):
    """Images -> one feature map at 1/4 resolution.

    With ``normalise`` the images are RGB of 0..255 and become 2 (x / 255) - 1 here; without it the
    caller has normalised them.
    """

    def __init__(self, features: int, normalise: bool) -> None:
        super().__init__()
        self.normalise = normalise
        self.conv1 = nn.Conv2d(3, STEM_WIDTH, 7, stride=2, padding=3, bias=False)
        widths = (STEM_WIDTH, *LAYER_WIDTHS)
        self.layer1, self.layer2, self.layer3 = (
            nn.Sequential(ResidualBlock(c_in, c_out, stride), ResidualBlock(c_out, c_out, 1))
            for c_in, c_out, stride in zip(widths, LAYER_WIDTHS, LAYER_STRIDES, strict=False)
        )
        self.conv2 = nn.Conv2d(LAYER_WIDTHS[-1], features, 1)

    def forward(self, images: torch.Tensor, rng: np.random.Generator | None = None) -> torch.Tensor:
        """(B, 3, H, W) -> (B, features, H/4, W/4), without a final norm; ``rng`` draws nothing."""
        x = 2 * (images / 255.0) - 1 if self.normalise else images
        x = F.relu(F.instance_norm(self.conv1(x)))
        y: torch.Tensor = self.conv2(self.layer3(self.layer2(self.layer1(x))))
        return y
