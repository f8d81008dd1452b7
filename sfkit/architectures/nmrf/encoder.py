"""The image encoder of ``nmrf-swint``: normalisation, Swin-T, deformable neck."""

from __future__ import annotations

import numpy as np
import torch
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
