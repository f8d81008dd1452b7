"""3-D convolutions that clean a cost volume, and the soft argmin that reads it.

AnyNet (Wang et al., ICRA 2019), section III-C: six pre-activated 3 x 3 x 3 convolutions a stage.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import nn

LAYERS = 6


class VolumeStack(nn.Sequential):
    """Raw costs (B, n, h, w) -> aggregated costs (B, n, h, w), signed; n may be any number of candidates."""

    def __init__(self, width: int) -> None:
        channels = [1, *[width] * (LAYERS - 1), 1]
        super().__init__(*[_unit(i, o) for i, o in pairwise(channels)])

    def forward(self, cost: torch.Tensor) -> torch.Tensor:
        maps = cost[:, None]
        for unit in self:
            maps = unit(maps)
        return maps[:, 0]


def soft_argmin(cost: torch.Tensor, first: int) -> torch.Tensor:
    """Expected candidate (B, h, w) of costs (B, n, h, w) of the candidates ``first``, ``first`` + 1, ..."""
    n = cost.shape[1]
    values = torch.arange(first, first + n, dtype=cost.dtype, device=cost.device)
    return (torch.softmax(-cost, dim=1) * values[:, None, None]).sum(dim=1)


def _unit(channels_in: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.BatchNorm3d(channels_in),
        nn.ReLU(inplace=True),
        nn.Conv3d(channels_in, channels_out, 3, padding=1, bias=False),
    )
