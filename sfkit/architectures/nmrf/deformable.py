"""Deformable attention (Deformable DETR, ICLR 2021) over one level, in plain PyTorch."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn

HEADS = 8
POINTS = 4
VALUE_RATIO = 0.5


class DeformableAttention(nn.Module):
    """Each query reads ``POINTS`` places a head from a value map, and weighs them.

    The places are the query's own position in the value map plus learned offsets, in pixels of the
    value map; outside the map there are zeros.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        inner = int(width * VALUE_RATIO)
        self.sampling_offsets = nn.Linear(width, HEADS * POINTS * 2)
        self.attention_weights = nn.Linear(width, HEADS * POINTS)
        self.value_proj = nn.Linear(width, inner)
        self.output_proj = nn.Linear(inner, width)

    def forward(self, queries: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
        """Queries (B, h, w, c) on one grid, values (B, h', w', c) on another -> (B, h, w, c)."""
        batch, height, width, _ = queries.shape
        grid = self._places(queries, values.shape[1:3])
        maps = self.value_proj(values).to(grid.dtype)
        maps = maps.unflatten(-1, (HEADS, -1)).permute(0, 3, 4, 1, 2).flatten(0, 1)
        samples = F.grid_sample(maps, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
        weights = self.attention_weights(queries).unflatten(-1, (HEADS, POINTS)).softmax(-1)
        weights = weights.permute(0, 3, 1, 2, 4).reshape(batch * HEADS, 1, height * width, POINTS)
        read = (samples * weights).sum(-1).reshape(batch, -1, height, width)
        y: torch.Tensor = self.output_proj(read.permute(0, 2, 3, 1))
        return y

    def _places(self, queries: torch.Tensor, value_size: torch.Size) -> torch.Tensor:
        """Sampling places (B * heads, h * w, points, xy) in -1..1, where +-1 are the map's outer edges."""
        batch, height, width, _ = queries.shape
        offsets = self.sampling_offsets(queries)
        # Half precision cannot hold a position to a fraction of a pixel.
        offsets = offsets if offsets.dtype == torch.float64 else offsets.float()
        offsets = offsets.reshape(batch, height, width, HEADS, POINTS, 2)
        x = (torch.arange(width, device=queries.device, dtype=offsets.dtype) + 0.5) / width
        y = (torch.arange(height, device=queries.device, dtype=offsets.dtype) + 0.5) / height
        across = x[:, None, None] + offsets[..., 0] / value_size[1]
        down = y[:, None, None, None] + offsets[..., 1] / value_size[0]
        places = 2 * torch.stack((across, down), -1) - 1
        return places.permute(0, 3, 1, 2, 4, 5).reshape(batch * HEADS, height * width, POINTS, 2)
