"""Distance-based cost volumes: the full one of stage 1, and the warped ones of the residual stages.

AnyNet (Wang et al., ICRA 2019), section III-C and III-D. A cost is the L1 distance of two feature
vectors, summed (not averaged) over channels. Disparities here are in pixels of the feature map.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F


def full_volume(left: torch.Tensor, right: torch.Tensor, candidates: int) -> torch.Tensor:
    """Costs (B, candidates, h, w) of the disparities 0, 1, ..., ``candidates`` - 1.

    ``left`` and ``right`` are features (B, C, h, w). Where x - d lies left of the image the right
    feature counts as zero, so the cost there is the norm of the left one.
    """
    width = right.shape[-1]
    # Padded once, so that every shift is a view.
    padded = F.pad(right, (candidates - 1, 0))
    shifted = [padded[..., candidates - 1 - d : candidates - 1 - d + width] for d in range(candidates)]
    return (left[:, :, None] - torch.stack(shifted, dim=2)).abs().sum(dim=1)


def residual_volume(
    left: torch.Tensor, right: torch.Tensor, disparity: torch.Tensor, reach: int, *, align_corners: bool
) -> torch.Tensor:
    """Costs (B, 2 * reach + 1, h, w) of the offsets k = -reach, ..., reach.

    ``left`` and ``right`` are features (B, C, h, w), ``disparity`` is (B, h, w). Offset k compares the
    left feature at x with the right one at x - disparity + k. Gradients reach ``disparity``.
    """
    batch, channels, height, width = right.shape
    offsets = torch.arange(-reach, reach + 1, dtype=left.dtype, device=left.device)
    x = torch.arange(width, dtype=left.dtype, device=left.device)
    y = torch.arange(height, dtype=left.dtype, device=left.device)
    columns = (x - disparity)[:, None] + offsets[:, None, None]
    # grid_sample counts from -1 to 1, whatever the width.
    grid_x = 2 * columns / max(width - 1, 1) - 1
    grid_y = (2 * y / max(height - 1, 1) - 1)[:, None].expand_as(grid_x)
    # All offsets lie below one another in one tall grid: a single call, and no copy of the features.
    grid = torch.stack([grid_x, grid_y], dim=-1).view(batch, -1, width, 2)
    warped = F.grid_sample(right, grid, mode="bilinear", padding_mode="zeros", align_corners=align_corners)
    return (left[:, :, None] - warped.view(batch, channels, -1, height, width)).abs().sum(dim=1)
