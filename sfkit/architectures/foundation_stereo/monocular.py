"""The frozen monocular branch: Depth Anything V2 as a feature extractor (paper section 3.1).

Nothing is downloaded: its weights are part of every FoundationStereo checkpoint.
"""

from __future__ import annotations

import math

import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.dense_head import DensePredictionHead, resize_corners
from sfkit.architectures.foundation_stereo.sizes import VitSize
from sfkit.architectures.foundation_stereo.vit import PATCH, VisionTransformer

STEP = 8 * PATCH  # the head halves the patch grid three times
LONGEST = 12 * STEP  # 1344 pixels


def input_size(height: int, width: int) -> tuple[int, int]:
    """The size in pixels to which a height x width image is resized for the ViT.

    Both sides go up to multiples of 112; if one exceeds 1344, the longer becomes 1344 and the other
    shrinks with it (again to a multiple of 112), so the aspect ratio is kept only roughly.
    """
    rows, cols = _ceil(height), _ceil(width)
    if max(rows, cols) <= LONGEST:
        return rows, cols
    if rows > cols:
        return LONGEST, _ceil(cols * LONGEST / rows)
    return _ceil(rows * LONGEST / cols), LONGEST


def _ceil(pixels: float) -> int:
    return math.ceil(pixels / STEP) * STEP


class DepthAnything(nn.Module):
    """ViT and dense-prediction head under the names published files use."""

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        self.pretrained = VisionTransformer(size)
        self.depth_head = DensePredictionHead(size)

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, 112 m, 112 n) -> (B, out_channels, 112 m, 112 n)."""
        dense: Tensor = self.depth_head(self.pretrained(images))
        return dense


class MonocularBranch(nn.Module):
    """Normalised images to monocular features at a quarter of their resolution; frozen."""

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        self.depth_anything = DepthAnything(size)
        self.requires_grad_(False)

    def forward(self, images: Tensor) -> Tensor:
        """Normalised images (B, 3, H, W) -> (B, out_channels, H / 4, W / 4).

        The two resizes at the end (to the ViT's input, then to a quarter of the image) are not merged:
        one resize gives other numbers.
        """
        height, width = images.shape[-2:]
        resized = F.interpolate(images, size=input_size(height, width), mode="bicubic", align_corners=False)
        return resize_corners(self.depth_anything(resized), (height // 4, width // 4))
