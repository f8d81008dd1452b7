"""Two ways to compute "ReLU, then a 3 x 3 x 3 convolution" that on a CPU are faster than ``Conv3d``.

``Conv3d`` at batch 1 falls to a generic kernel that takes most of AnyNet's time. ``direct`` calls oneDNN,
which suits wide layers and many planes. ``banded`` writes the planes as channels of a 2-D convolution
whose weight is zero where planes are no neighbours: it multiplies some zeros, but fills the vector
registers that four channels leave empty, forwards and backwards.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F

Convolution = Callable[[torch.Tensor, torch.Tensor, torch.Tensor | None], torch.Tensor]

_ONES = (1, 1, 1)


def direct(maps: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None) -> torch.Tensor:
    """(B, I, D, h, w) with weight (O, I, 3, 3, 3) -> (B, O, D, h, w), padded by zeros."""
    # In other types and places PyTorch chooses by itself.
    if maps.device.type != "cpu" or maps.dtype != torch.float32 or not _onednn_is_here():
        return F.conv3d(F.relu(maps), weight, bias, padding=1)
    # The layout changes before the ReLU, whose gradient is slow where the layouts of two tensors differ.
    active = F.relu(maps.contiguous(memory_format=torch.channels_last_3d))
    return torch.mkldnn_convolution(active, weight, bias, _ONES, _ONES, _ONES, 1)


def banded(maps: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None) -> torch.Tensor:
    """The same as ``direct``; the multiplied zeros cost a factor of about D / 3."""
    planes = maps.shape[2]
    # At every call: merges change the weights in place.
    band = _band(weight, planes).contiguous(memory_format=torch.channels_last)
    # Planes have become channels, of which each has a bias.
    if bias is not None:
        bias = bias.repeat_interleave(planes)
    active = F.relu(maps.flatten(1, 2).contiguous(memory_format=torch.channels_last))
    result = F.conv2d(active, band, bias, padding=1)
    return result.view(maps.shape[0], -1, *maps.shape[2:])


def _band(weight: torch.Tensor, planes: int) -> torch.Tensor:
    """(O, I, 3, 3, 3) -> (O * planes, I * planes, 3, 3): plane d reads the planes d - 1, d and d + 1."""
    to = torch.arange(planes, device=weight.device)[:, None]
    tap = torch.arange(3, device=weight.device)[:, None, None]
    reads = (to + tap - 1 == to.T).to(weight.dtype)  # (3, to, from)
    out, in_ = weight.shape[:2]
    return torch.einsum("oikyx,kde->odieyx", weight, reads).reshape(out * planes, in_ * planes, 3, 3)


def _onednn_is_here() -> bool:
    return bool(torch.backends.mkldnn.is_available())  # type: ignore[no-untyped-call]  # untyped in torch
