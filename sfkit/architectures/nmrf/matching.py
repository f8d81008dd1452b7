"""Matching features, and what a candidate disparity looks like in them: the unary embedding's input.

The same two projections serve 1/8 resolution (inference) and 1/4 resolution (refinement). A
disparity is in pixels of the resolution it is used at.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

CONCAT_WIDTH = 64
GROUP_WIDTH = 256
CORRELATIONS = 32
UNARY_WIDTH = 2 * CONCAT_WIDTH + CORRELATIONS


def projection(features: int, hidden: int, width: int) -> nn.Sequential:
    """3x3 convolution, instance norm, ReLU, 1x1 convolution; (B, features, h, w) -> (B, width, h, w)."""
    return nn.Sequential(
        nn.Conv2d(features, hidden, 3, padding=1, bias=False),
        nn.InstanceNorm2d(hidden),
        nn.ReLU(),
        nn.Conv2d(hidden, width, 1, bias=False),
    )


@dataclass(frozen=True)
class MatchingFeatures:
    """Both images' features at one resolution, channels last: 64 to concatenate, then 256 to correlate."""

    left: torch.Tensor  # (B, h, w, 320)
    right: torch.Tensor  # (B, h, w, 320)

    @classmethod
    def from_encoder(
        cls, concatconv: nn.Module, gw: nn.Module, left: torch.Tensor, right: torch.Tensor
    ) -> MatchingFeatures:
        """Encoder features (B, F, h, w) of both images -> matching features."""
        both = torch.cat((left, right))
        projected = torch.cat((concatconv(both), gw(both)), 1).permute(0, 2, 3, 1).contiguous()
        return cls(*projected.chunk(2))

    def unary(self, disparity: torch.Tensor) -> torch.Tensor:
        """Candidates (B, h, w, N) -> (B, h, w, N, 160): left, warped right, 32 group correlations."""
        warped = warp(self.right, disparity)
        own = self.left[..., None, :]
        products = own[..., CONCAT_WIDTH:] * warped[..., CONCAT_WIDTH:]
        groups = products.reshape(*disparity.shape, CORRELATIONS, -1)
        concat = own[..., :CONCAT_WIDTH].expand(*warped.shape[:-1], -1)
        return torch.cat((concat, warped[..., :CONCAT_WIDTH], groups.mean(-1)), -1)


def warp(right: torch.Tensor, disparity: torch.Tensor) -> torch.Tensor:
    """Read the right map at (x - d, y), linearly interpolated, zero outside the map.

    No gradient goes to the disparity. A disparity that is not finite reads values that are not.

    Args:
        right: (B, h, w, C).
        disparity: (B, h, w, N), in pixels of this map.

    Returns:
        (B, h, w, N, C).
    """
    batch, height, width, channels = right.shape
    x = torch.arange(width, device=right.device, dtype=disparity.dtype)
    place = x[:, None] - disparity.detach()
    before = place.floor()
    fraction = (place - before)[..., None]
    rows = torch.arange(batch * height, device=right.device).reshape(batch, height, 1, 1) * width
    table = right.reshape(-1, channels)

    def read(column: torch.Tensor) -> torch.Tensor:
        inside = column.clamp(0, width - 1)
        index = rows + inside.long().clamp(0, width - 1)  # a NaN has no integer: clamp again
        found = table.index_select(0, index.flatten()).reshape(*column.shape, channels)
        # What was read at a clamped column lies outside the image, and counts as zero.
        return found * (column == inside)[..., None]

    return torch.lerp(read(before), read(before + 1), fraction.to(right.dtype))
