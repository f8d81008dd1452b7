"""Spatial propagation: the last stage sharpens disparity edges along those of the left image.

AnyNet (Wang et al., ICRA 2019), section III-E; the scan is the three-way one of Liu et al., "Learning
Affinity via Spatial Propagation Networks" (NeurIPS 2017), from left to right only.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn

WIDTH = 8
SCALE = 4  # the stage works at a quarter of the image size


def spatial_propagation() -> nn.Sequential:
    """The part under ``refine_spn``: guide network, way in, way out, in that order."""
    guide = nn.Sequential(
        *[_conv(3, 2 * WIDTH), nn.ReLU(inplace=True)],
        *[_conv(2 * WIDTH, 2 * WIDTH), nn.ReLU(inplace=True)],
        *[_conv(2 * WIDTH, 2 * WIDTH), nn.ReLU(inplace=True)],
        _conv(2 * WIDTH, 3 * WIDTH),
    )
    return nn.Sequential(guide, _conv(1, WIDTH), _conv(WIDTH, 1))


def refine(parts: nn.Sequential, image: torch.Tensor, disparity: torch.Tensor) -> torch.Tensor:
    """Disparity (B, H, W) -> refined disparity (B, H, W), in pixels; ``image`` (B, 3, H, W) is the left."""
    height, width = image.shape[-2:]
    small = (height // SCALE, width // SCALE)
    guide, enter, leave = parts
    gates = guide(_resize(image, small)).unflatten(1, (3, WIDTH))
    state = enter(_resize(disparity[:, None], small))
    refined: torch.Tensor = _resize(leave(propagate(state, _normalised(gates))), (height, width))
    return refined[:, 0]


def propagate(state: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
    """One scan from the left column to the right one, for each map on its own.

    ``state`` is X (B, C, h, w), ``gates`` are G (B, 3, C, h, w) for the upper, middle and lower
    neighbour in the column before; a gate whose neighbour lies outside the map is closed:
    Y[y, t] = (1 - g1 - g2 - g3) X[y, t] + g1 Y[y-1, t-1] + g2 Y[y, t-1] + g3 Y[y+1, t-1].
    """
    height = state.shape[2]
    gates = _closed_at_borders(gates)
    fresh = ((1 - gates.sum(dim=1)) * state).unbind(-1)
    steps = gates.movedim(1, 2).unbind(-1)  # each (B, C, 3, h)
    columns = [fresh[0]]
    for start, gate in zip(fresh[1:], steps[1:], strict=True):
        neighbours = F.pad(columns[-1], (1, 1)).unfold(-1, height, 1)
        columns.append(start + (gate * neighbours).sum(dim=-2))
    return torch.stack(columns, dim=-1)


def _closed_at_borders(gates: torch.Tensor) -> torch.Tensor:
    open_ = torch.ones_like(gates[0, :, 0])  # (3, h, w)
    open_[0, 0] = 0
    open_[2, -1] = 0
    open_[:, :, 0] = 0
    return gates * open_[:, None]


def _normalised(gates: torch.Tensor) -> torch.Tensor:
    return gates / (gates.abs().sum(dim=1, keepdim=True) + 1e-8)


def _resize(maps: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    return F.interpolate(maps, size=size, mode="bilinear", align_corners=False)


def _conv(channels_in: int, channels_out: int) -> nn.Conv2d:
    return nn.Conv2d(channels_in, channels_out, 3, padding=1, bias=False)
