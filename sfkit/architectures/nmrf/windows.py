"""Windows of a token grid: cutting, joining, the shift's regions, and relative positions.

A grid is (B, H, W, ...) with rows first. Windows are square, ordered row by row, and so are the
T = size * size positions inside each (Swin Transformer, ICCV 2021, section 3.2; NMRF uses the same
scheme for its messages).
"""

from __future__ import annotations

import torch


def whole(length: int, size: int) -> int:
    """``length`` rounded up to whole windows; exporters of any size follow no remainder."""
    return (length + size - 1) // size * size


def cut(grid: torch.Tensor, size: int) -> torch.Tensor:
    """(B, H, W, *rest) -> (B, windows, T, *rest); H and W are multiples of ``size``."""
    batch, height, width, *rest = grid.shape
    tiles = grid.reshape(batch, height // size, size, width // size, size, *rest).transpose(2, 3)
    return tiles.reshape(batch, height * width // size**2, size * size, *rest)


def join(tiles: torch.Tensor, size: int, height: int, width: int) -> torch.Tensor:
    """Undo :func:`cut`: (B, windows, T, *rest) -> (B, H, W, *rest)."""
    batch, _, _, *rest = tiles.shape
    grid = tiles.reshape(batch, height // size, width // size, size, size, *rest).transpose(2, 3)
    return grid.reshape(batch, height, width, *rest)


def strangers(grid: torch.Size, size: int, device: torch.device) -> torch.Tensor:
    """Which pairs of a shifted window come from different image regions: (windows, T, T) bool.

    ``grid`` is (height, width). It has already been rolled by half a window (``size // 2``, rounded
    down), so the last window of an axis holds two bands that were never neighbours; along an axis of
    length n the bands are [0, n - size), [n - size, n - size // 2), [n - size // 2, n).
    """
    height, width = grid
    # Three bands a side, by which parts that were no neighbours before the roll are told.
    region = 3 * _bands(height, size, device)[:, None] + _bands(width, size, device)[None, :]
    of = cut(region[None], size)[0]
    return of[:, :, None] != of[:, None, :]


def _bands(length: int, size: int, device: torch.device) -> torch.Tensor:
    place = torch.arange(length, device=device)
    return (place >= length - size).long() + (place >= length - size // 2).long()


def relative_position_index(size: int) -> torch.Tensor:
    """Row of a relative-position table for each (query, key) pair: (T, T) int64.

    (row_q - row_k + size - 1) * (2 size - 1) + (col_q - col_k + size - 1).
    """
    place = torch.arange(size)
    rows, cols = (axis.reshape(-1) for axis in torch.meshgrid(place, place, indexing="ij"))
    down = rows[:, None] - rows[None, :] + size - 1
    across = cols[:, None] - cols[None, :] + size - 1
    return down * (2 * size - 1) + across
