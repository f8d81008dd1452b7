"""Cutting, joining and shifting windows, position by position."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sfkit.architectures.nmrf import windows


@given(rows=st.integers(1, 3), cols=st.integers(1, 3), size=st.integers(2, 5))
def test_join_undoes_cut_and_windows_run_row_by_row(rows: int, cols: int, size: int) -> None:
    grid = torch.arange(rows * cols * size**2).reshape(1, rows * size, cols * size)
    tiles = windows.cut(grid, size)
    assert torch.equal(windows.join(tiles, size, rows * size, cols * size), grid)
    for r, c in np.ndindex(rows, cols):
        tile = grid[0, r * size : (r + 1) * size, c * size : (c + 1) * size]
        assert torch.equal(tiles[0, r * cols + c], tile.flatten())


@given(length=st.integers(0, 100), size=st.integers(1, 9))
def test_whole_windows_hold_a_length_and_no_window_more(length: int, size: int) -> None:
    found = windows.whole(length, size)
    assert found % size == 0
    assert length <= found < length + size


@pytest.mark.parametrize("size", [2, 4, 7])
def test_relative_position_index_pair_by_pair(size: int) -> None:
    index = windows.relative_position_index(size)
    for i, j in np.ndindex(size**2, size**2):
        down, across = i // size - j // size, i % size - j % size
        assert index[i, j] == (down + size - 1) * (2 * size - 1) + across + size - 1


@pytest.mark.parametrize(("height", "width", "size"), [(7, 14, 7), (12, 8, 4), (6, 18, 6)])
def test_strangers_are_pixels_that_were_no_neighbours_before_the_roll(
    height: int, width: int, size: int
) -> None:
    found = windows.strangers(torch.Size((height, width)), size, torch.device("cpu"))
    shift = size // 2
    origin = torch.stack(torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij"), -1)
    tiles = windows.cut(origin.roll((-shift, -shift), (0, 1))[None], size)[0]
    # Two pixels of one window belong together where they lie as far apart as they did in the image.
    for w, i, j in np.ndindex(*found.shape):
        apart = tiles[w, i] - tiles[w, j]
        inside = torch.tensor([i // size - j // size, i % size - j % size])
        assert bool(found[w, i, j]) == (not torch.equal(apart, inside))
