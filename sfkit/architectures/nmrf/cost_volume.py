"""Group-wise correlation between the two images at 1/8 resolution; no parameters."""

from __future__ import annotations

import torch

GROUPS = 4
STRIDE = 8  # one disparity bin is eight pixels


def cost_volume(left: torch.Tensor, right: torch.Tensor, bins: int) -> torch.Tensor:
    """Mean product of the features of (x, y) on the left and (x - d, y) on the right, by channel group.

    Args:
        left: (B, F, h, w) features at 1/8 resolution.
        right: the same of the right image.
        bins: D, the number of disparities d = 0 .. D - 1, in units of 1/8 px (8 px of the image).

    Returns:
        (B, h, w, G, D); exactly 0 where x < d.
    """
    batch, channels, height, width = left.shape
    # All pairs of one row at once: a matrix product is cheaper than D shifted products, and small.
    shape = (batch, GROUPS, channels // GROUPS, height, width)
    a = left.reshape(shape).permute(0, 3, 1, 4, 2)
    b = right.reshape(shape).permute(0, 3, 1, 2, 4)
    pairs = (a @ b) / (channels // GROUPS)
    x = torch.arange(width, device=left.device)
    matching = x[:, None] - torch.arange(bins, device=left.device)[None, :]
    index = matching.clamp(min=0).expand(*pairs.shape[:3], width, bins)
    cost = pairs.gather(-1, index).masked_fill(matching < 0, 0.0)
    return cost.transpose(2, 3)
