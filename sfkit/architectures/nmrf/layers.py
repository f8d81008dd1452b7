"""Small parts that all of NMRF is built from: perceptrons, the code of a disparity, and what tokens write.

No upsampling is learned or interpolated: a token at 1/8 resolution writes 8x8 pixels, one at 1/4
writes 4x4, row by row.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.portable import is_portable


class FeedForward(nn.Module):
    """Linear, exact GELU, linear; (..., c_in) -> (..., c_out)."""

    def __init__(self, c_in: int, hidden: int, c_out: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(c_in, hidden)
        self.fc2 = nn.Linear(hidden, c_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., c_in) -> (..., c_out)."""
        y: torch.Tensor = self.fc2(F.gelu(self.fc1(x)))
        return y


class Head(nn.Module):
    """Three linear layers with ReLU between them; (..., width) -> (..., c_out)."""

    def __init__(self, width: int, c_out: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(width, out) for out in (width, width, c_out))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., width) -> (..., c_out)."""
        first, second, last = self.layers
        y: torch.Tensor = last(F.relu(second(F.relu(first(x)))))
        return y


BANDS = 15
LENGTH = 2 * BANDS + 1

# 3.14, not pi: the top band multiplies every difference by 2^14, and the weights were trained with 3.14.
EIGHTH_UNIT = 3.14 / 64
QUARTER_UNIT = 3.14 / 128


def disparity_code(disparity: torch.Tensor, unit: float) -> torch.Tensor:
    """(...) disparities -> (..., 31): sin(u 2^i), cos(u 2^i), i = 0 .. 14, and u = disparity * unit.

    ``unit`` is ``EIGHTH_UNIT`` for disparities in 1/8 px and ``QUARTER_UNIT`` for 1/4 px. The result
    is float32, also under autocast (float64 if the input is): half precision would turn the upper
    bands into noise. u is one rounded product, which the powers of two then scale exactly.
    """
    # Autocast leaves pointwise functions alone, so the input's precision decides.
    value = disparity if disparity.dtype == torch.float64 else disparity.float()
    u = (value * unit)[..., None]
    powers = torch.arange(BANDS, device=u.device, dtype=u.dtype)
    bands = u * torch.exp2(powers)
    return torch.cat((bands.sin(), bands.cos(), u), -1)


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
    values = blocks.flatten(-2)
    if is_portable():  # ONNX has no median
        return values.sort(-1).values[..., (size * size - 1) // 2]
    return values.median(-1).values
