"""From tokens to disparities: each token emits its block of sub-pixels; the best candidate wins.

No upsampling is learned or interpolated: a token at 1/8 resolution writes 8x8 pixels, one at 1/4
writes 4x4, row by row.
"""

from __future__ import annotations

import torch


def spread(blocks: torch.Tensor, size: int) -> torch.Tensor:
    """(B, h, w, N, size * size) -> (B, h * size, w * size, N): entry size * r + c goes to pixel (r, c)."""
    batch, height, width, candidates, _ = blocks.shape
    pixels = blocks.reshape(batch, height, width, candidates, size, size).permute(0, 1, 4, 2, 5, 3)
    return pixels.reshape(batch, height * size, width * size, candidates)


def winner(disparity: torch.Tensor, score: torch.Tensor) -> torch.Tensor:
    """Disparity of the candidate with the highest score; both (B, H, W, N) -> (B, H, W). Ties: the first."""
    best = score.argmax(-1, keepdim=True)
    return disparity.gather(-1, best).squeeze(-1)


def lower_median(pixels: torch.Tensor, size: int) -> torch.Tensor:
    """Per size x size block the lower of the two middle values; (B, H, W) -> (B, H / size, W / size)."""
    batch, height, width = pixels.shape
    blocks = pixels.reshape(batch, height // size, size, width // size, size).transpose(2, 3)
    return blocks.flatten(-2).median(-1).values
