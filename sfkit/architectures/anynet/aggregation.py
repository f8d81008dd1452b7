"""3-D convolutions that clean a cost volume, and the soft argmin that reads it.

AnyNet (Wang et al., ICRA 2019), section III-C: six pre-activated 3 x 3 x 3 convolutions a stage.
"""

from __future__ import annotations

from enum import StrEnum
from itertools import pairwise
from typing import cast

import torch
from torch import nn

from sfkit.architectures.anynet.convolution import Convolution, banded, direct
from sfkit.architectures.portable import is_portable

LAYERS = 6
WIDEST_BAND = 8  # channels; wider layers fill the vector registers by themselves


class Route(StrEnum):
    """How a stack computes its convolutions; the results agree within rounding. Exports take PLAIN."""

    FAST = "fast"
    PLAIN = "plain"  # batch norm, ReLU and Conv3d one after the other: the reference of tests and benchmarks


class VolumeStack(nn.Sequential):
    """Raw costs (B, n, h, w) -> aggregated costs (B, n, h, w), signed; n may be any number of candidates.

    Attributes:
        route: fast by default; may be changed at any time.
    """

    def __init__(self, width: int) -> None:
        channels = [1, *[width] * (LAYERS - 1), 1]
        super().__init__(*[_Unit(i, o) for i, o in pairwise(channels)])
        self.width = width
        self.route = Route.FAST

    def forward(self, cost: torch.Tensor) -> torch.Tensor:
        maps = cost[:, None]
        units = [cast(_Unit, unit) for unit in self]
        convolve = banded if self.width <= WIDEST_BAND and cost.device.type == "cpu" else direct
        if self.route is Route.PLAIN or is_portable():
            for unit in units:
                maps = unit(maps)
        elif self.training:
            maps = _with_batch_statistics(units, maps, convolve)
        else:
            maps = _with_running_statistics(units, maps, convolve)
        return maps[:, 0]


def soft_argmin(cost: torch.Tensor, first: int) -> torch.Tensor:
    """Expected candidate (B, h, w) of costs (B, n, h, w) of the candidates ``first``, ``first`` + 1, ..."""
    n = cost.shape[1]
    values = torch.arange(first, first + n, dtype=cost.dtype, device=cost.device)
    return (torch.softmax(-cost, dim=1) * values[:, None, None]).sum(dim=1)


class _Unit(nn.Sequential):
    """Batch norm, ReLU, convolution, under the keys 0, 1 and 2."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__(
            nn.BatchNorm3d(channels_in),
            nn.ReLU(inplace=True),
            nn.Conv3d(channels_in, channels_out, 3, padding=1, bias=False),
        )

    @property
    def weight(self) -> torch.Tensor:
        return cast(nn.Conv3d, self[2]).weight

    def normalised(self, maps: torch.Tensor) -> torch.Tensor:
        return cast(torch.Tensor, self[0](maps))

    def affine(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale and shift (C, 1, 1, 1): what the batch norm does with its running statistics."""
        norm = cast(nn.BatchNorm3d, self[0])
        variance, mean = cast(torch.Tensor, norm.running_var), cast(torch.Tensor, norm.running_mean)
        # In evaluation mode a norm is a factor and a shift.
        scale = norm.weight * torch.rsqrt(variance + norm.eps)
        return scale[:, None, None, None], (norm.bias - mean * scale)[:, None, None, None]


def _with_batch_statistics(units: list[_Unit], maps: torch.Tensor, convolve: Convolution) -> torch.Tensor:
    for unit in units:
        # Forwards and backwards, batch norm is slow on any layout but the default.
        maps = unit.normalised(maps.contiguous())
        if maps.requires_grad:
            maps.register_hook(torch.Tensor.contiguous)  # type: ignore[no-untyped-call]  # untyped in torch
        maps = convolve(maps, unit.weight, None)
    return maps


def _with_running_statistics(units: list[_Unit], maps: torch.Tensor, convolve: Convolution) -> torch.Tensor:
    """Each batch norm as part of the convolution before it, folded at every call because weights change."""
    scale, shift = units[0].affine()
    # The first norm has no convolution before it that it could be folded into.
    maps = maps * scale + shift
    for unit, following in pairwise(units):
        scale, shift = following.affine()
        maps = convolve(maps, unit.weight * scale[..., None], shift.flatten())
    return convolve(maps, units[-1].weight, None)
