"""Spatial propagation: the last stage sharpens disparity edges along those of the left image.

AnyNet (Wang et al., ICRA 2019), section III-E; the scan is the three-way one of Liu et al., "Learning
Affinity via Spatial Propagation Networks" (NeurIPS 2017), from left to right only.
"""

from __future__ import annotations

from typing import Any, cast

import torch
import torch.nn.functional as F
from torch import nn
from torch.autograd.function import once_differentiable

from sfkit.architectures.portable import is_portable

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
    # Gates of one place sum to at most 1: else a scan over hundreds of columns grows without bound.
    gates = gates / (gates.abs().sum(dim=1, keepdim=True) + 1e-8)
    state = enter(_resize(disparity[:, None], small))
    refined: torch.Tensor = _resize(leave(propagate(state, gates)), (height, width))
    return refined[:, 0]


def propagate(state: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
    """One scan from the left column to the right one, for each map on its own: Y (B, C, h, w).

    ``state`` is X (B, C, h, w), ``gates`` are G (B, 3, C, h, w) for the upper, middle and lower
    neighbour in the column before; a gate whose neighbour lies outside the map is closed:
    Y[y, t] = (1 - g1 - g2 - g3) X[y, t] + g1 Y[y-1, t-1] + g2 Y[y, t-1] + g3 Y[y+1, t-1].
    """
    gates = gates * _open(gates)
    fresh = (1 - gates.sum(dim=1)) * state
    # Exporters cannot look into an autograd function that writes in place.
    run = _plain_scan if is_portable() else _Scan.apply
    columns = run(fresh.movedim(-1, 0), gates.movedim(-1, 0).movedim(2, 1))
    return cast(torch.Tensor, columns).movedim(0, -1)


class _Scan(torch.autograd.Function):
    """Y[t] = F[t] + G1[t] * up(Y[t-1]) + G2[t] * Y[t-1] + G3[t] * down(Y[t-1]), in place.

    F is (w, B, C, h), G is (w, 3, B, C, h). Columns come first, so that a step reads adjacent memory, and
    have a margin of one row at both ends, so that a shift is a view. Autograd's own record of the loop
    would hold a dozen small nodes a column.
    """

    @staticmethod
    def forward(ctx: Any, fresh: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
        gates = gates.contiguous()
        padded = F.pad(fresh, (1, 1))
        above, here, below = (v.unbind() for v in _shifts(padded))
        first, second, third = gates.unbind(1)
        # Column after column, since each needs the one before.
        for t in range(1, len(fresh)):
            here[t].addcmul_(first[t], above[t - 1])
            here[t].addcmul_(second[t], here[t - 1])
            here[t].addcmul_(third[t], below[t - 1])
        ctx.save_for_backward(padded, gates)
        return padded[..., 1:-1]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        padded, gates = ctx.saved_tensors
        total = F.pad(grad, (1, 1))
        above, here, below = (v.unbind() for v in _shifts(total))
        first, second, third = gates.unbind(1)
        # The other way: what a column gave to the next comes back from it.
        for t in range(len(total) - 1, 0, -1):
            above[t - 1].addcmul_(first[t], here[t])
            here[t - 1].addcmul_(second[t], here[t])
            below[t - 1].addcmul_(third[t], here[t])
        fresh = total[..., 1:-1]
        # The first column has no neighbour before it, and its gates no gradient.
        grad_gates = torch.zeros_like(gates)
        for i, neighbour in enumerate(_shifts(padded)):
            torch.mul(fresh[1:], neighbour[:-1], out=grad_gates[1:, i])
        return fresh, grad_gates


def _plain_scan(fresh: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
    """The same as an operator that stays one loop in an exported file, whatever the width."""
    fresh, gates = fresh.contiguous(), gates.contiguous()
    if torch.jit.is_tracing():  # type: ignore[attr-defined,no-untyped-call]  # as torch has it
        return cast(torch.Tensor, torch.jit.script(_scripted_scan)(fresh, gates))
    from torch._higher_order_ops import scan  # only exports need it

    return cast(torch.Tensor, scan(_column, torch.zeros_like(fresh[0]), (fresh, gates))[1])


def _column(
    before: torch.Tensor, now: tuple[torch.Tensor, torch.Tensor]
) -> tuple[torch.Tensor, torch.Tensor]:
    fresh, gates = now
    above, here, below = _shifts(F.pad(before, (1, 1)))
    column = fresh + gates[0] * above + gates[1] * here + gates[2] * below
    return column, column.clone()  # what is carried on and what is kept may not be one tensor


def _scripted_scan(fresh: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
    column = torch.zeros_like(fresh[0])
    columns: list[torch.Tensor] = []
    for t in range(fresh.shape[0]):
        # Nothing is passed on from rows beyond the image.
        padded = F.pad(column, [1, 1])
        above, below = padded[..., :-2], padded[..., 2:]
        column = fresh[t] + gates[t, 0] * above + gates[t, 1] * column + gates[t, 2] * below
        columns.append(column)
    return torch.stack(columns)


def _shifts(padded: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Views (..., h) of (..., h + 2): the row above, the row itself, the row below."""
    return padded[..., :-2], padded[..., 1:-1], padded[..., 2:]


def _open(gates: torch.Tensor) -> torch.Tensor:
    """(3, 1, h, w): 0 where the neighbour lies outside the map, else 1."""
    mask = torch.ones_like(gates[0, :, :1])
    mask[0, :, 0] = 0
    mask[2, :, -1] = 0
    mask[..., 0] = 0
    return mask


def _resize(maps: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    return F.interpolate(maps, size=size, mode="bilinear", align_corners=False)


def _conv(channels_in: int, channels_out: int) -> nn.Conv2d:
    return nn.Conv2d(channels_in, channels_out, 3, padding=1, bias=False)
