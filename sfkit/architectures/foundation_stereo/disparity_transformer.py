"""Self-attention along disparity, the long-range half of the cost filtering (paper section 3.2).

Every pixel of the volume at 1/16 resolution is a sequence of D / 4 tokens, one a disparity.
"""

from __future__ import annotations

from enum import StrEnum

import torch
import torch.nn.functional as F
from torch import Tensor, nn

LAYERS = 4
HEADS = 4


class DisparityAttention(StrEnum):
    """Over what the disparity transformer's attention runs; see ``SelfAttention``."""

    DISPARITY = "disparity"
    HEADS = "heads"


class SelfAttention(nn.Module):
    """Multi-head self-attention in one of the two ways public releases have computed it.

    ``disparity`` is what the paper describes: each head attends over the tokens of a sequence.
    ``heads`` is what a later revision of the authors' repository computes: for each token alone, the
    heads attend to each other, and nothing passes between disparities.
    """

    def __init__(self, width: int, over: DisparityAttention) -> None:
        super().__init__()
        self.over = over
        self.q_proj = nn.Linear(width, width)
        self.k_proj = nn.Linear(width, width)
        self.v_proj = nn.Linear(width, width)
        self.out_proj = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(N, L, width) -> (N, L, width)."""
        q, k, v = (p(x).unflatten(2, (HEADS, -1)) for p in (self.q_proj, self.k_proj, self.v_proj))
        if self.over is DisparityAttention.DISPARITY:
            mixed = F.scaled_dot_product_attention(q.transpose(1, 2), k.transpose(1, 2), v.transpose(1, 2))
            mixed = mixed.transpose(1, 2)
        else:
            mixed = F.scaled_dot_product_attention(q, k, v)
        out: Tensor = self.out_proj(mixed.flatten(2))
        return out


class TransformerLayer(nn.Module):
    """One post-norm layer: attention, then two linear layers with an exact GELU."""

    def __init__(self, width: int, over: DisparityAttention) -> None:
        super().__init__()
        self.self_attn = SelfAttention(width, over)
        self.norm1 = nn.LayerNorm(width)
        self.linear1 = nn.Linear(width, width)
        self.linear2 = nn.Linear(width, width)
        self.norm2 = nn.LayerNorm(width)

    def forward(self, x: Tensor) -> Tensor:
        """(N, L, width) -> (N, L, width)."""
        x = self.norm1(x + self.self_attn(x))
        out: Tensor = self.norm2(x + self.linear2(F.gelu(self.linear1(x))))
        return out


def position_code(length: int, width: int, device: torch.device) -> Tensor:
    """Sine and cosine of each position, interleaved (Vaswani et al. 2017, section 3.5): (length, width)."""
    position = torch.arange(length, dtype=torch.float32, device=device)[:, None]
    frequency = 10000.0 ** (-torch.arange(0, width, 2, dtype=torch.float32, device=device) / width)
    phase = position * frequency
    return torch.stack([phase.sin(), phase.cos()], dim=-1).flatten(1)


class DisparityTransformer(nn.Module):
    """A volume's pixels as sequences along disparity, through four layers of self-attention."""

    def __init__(self, width: int, over: DisparityAttention) -> None:
        super().__init__()
        self.sa = nn.ModuleList(TransformerLayer(width, over) for _ in range(LAYERS))

    def forward(self, volume: Tensor) -> Tensor:
        """(B, width, L, h, w) -> the same shape."""
        batch, width, length, height, cols = volume.shape
        x = volume.permute(0, 3, 4, 2, 1).reshape(-1, length, width)
        x = x + position_code(length, width, x.device)
        for layer in self.sa:
            x = layer(x)
        return x.view(batch, height, cols, length, width).permute(0, 4, 3, 1, 2)
