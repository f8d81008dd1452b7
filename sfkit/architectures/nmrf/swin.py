"""Swin-T (Swin Transformer, ICCV 2021), the backbone of ``nmrf-swint``: features at 1/4 to 1/32.

There is no absolute position embedding and no norm on the outputs: the neck normalises what it takes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf import windows
from sfkit.architectures.nmrf.layers import FeedForward

EMBED = 96
DEPTHS = (2, 2, 6, 2)
HEADS = (3, 6, 12, 24)
WINDOW = 7
PATCH = 4
WIDTHS = tuple(EMBED * 2**stage for stage in range(len(DEPTHS)))
REGION_PENALTY = -100.0  # finite on purpose: the published weights were trained with it


class WindowAttention(nn.Module):
    """Self-attention inside 7x7 windows with a learned bias for each relative position."""

    relative_position_index: torch.Tensor

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.relative_position_bias_table = nn.Parameter(torch.zeros((2 * WINDOW - 1) ** 2, heads))
        self.register_buffer("relative_position_index", windows.relative_position_index(WINDOW))
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)

    def forward(self, x: torch.Tensor, penalty: torch.Tensor | None) -> torch.Tensor:
        """(B, windows, T, c) -> same; ``penalty`` (windows, 1, T, T) is added to the logits."""
        batch, count, tokens, width = x.shape
        q, k, v = self.qkv(x).reshape(batch, count, tokens, 3, self.heads, -1).permute(3, 0, 1, 4, 2, 5)
        logits = ((q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)).add_(self._bias())
        if penalty is not None:
            logits.add_(penalty)
        out = logits.softmax(-1) @ v
        y: torch.Tensor = self.proj(out.transpose(2, 3).reshape(batch, count, tokens, width))
        return y

    def _bias(self) -> torch.Tensor:
        """(heads, T, T)."""
        return self.relative_position_bias_table[self.relative_position_index].permute(2, 0, 1)


class Block(nn.Module):
    """Pre-norm window attention and feed-forward; every second block looks at windows shifted by half."""

    def __init__(self, width: int, heads: int, shifted: bool) -> None:
        super().__init__()
        self.shift = WINDOW // 2 if shifted else 0
        self.norm1 = nn.LayerNorm(width)
        self.attn = WindowAttention(width, heads)
        self.norm2 = nn.LayerNorm(width)
        self.mlp = FeedForward(width, 4 * width, width)

    def forward(self, x: torch.Tensor, penalty: torch.Tensor, keep: torch.Tensor | None) -> torch.Tensor:
        """(B, h, w, c) -> same; ``keep`` (2, B, 1, 1, 1) are the two branches' stochastic-depth factors."""
        attended = self._attend(self.norm1(x), penalty)
        x = x + (attended if keep is None else keep[0] * attended)
        y: torch.Tensor = self.mlp(self.norm2(x))
        return x + (y if keep is None else keep[1] * y)

    def _attend(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        height, width = x.shape[1:3]
        # The padding comes after the norm: padded tokens are exact zeros, and take part unmasked.
        bottom, right = windows.whole(height, WINDOW) - height, windows.whole(width, WINDOW) - width
        x = F.pad(x, (0, 0, 0, right, 0, bottom))
        padded = x.shape[1:3]
        if self.shift:
            x = x.roll((-self.shift, -self.shift), (1, 2))
        tiles = self.attn(windows.cut(x, WINDOW), penalty if self.shift else None)
        x = windows.join(tiles, WINDOW, *padded)
        if self.shift:
            x = x.roll((self.shift, self.shift), (1, 2))
        return x[:, :height, :width]


class PatchMerging(nn.Module):
    """Halve the resolution: four neighbours concatenated, normalised, projected to twice the width."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.reduction = nn.Linear(4 * width, 2 * width, bias=False)
        self.norm = nn.LayerNorm(4 * width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, h, w, c) with h and w even -> (B, h/2, w/2, 2c)."""
        # In the order of the published weights: down before across.
        corners = (x[:, 0::2, 0::2], x[:, 1::2, 0::2], x[:, 0::2, 1::2], x[:, 1::2, 1::2])
        y: torch.Tensor = self.reduction(self.norm(torch.cat(corners, -1)))
        return y


class SwinStage(nn.Module):
    """The blocks at one resolution, and the way down to the next (none after the last)."""

    def __init__(self, width: int, depth: int, heads: int, last: bool) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(Block(width, heads, shifted=i % 2 == 1) for i in range(depth))
        self.downsample = None if last else PatchMerging(width)

    def forward(
        self, x: torch.Tensor, keeps: Iterator[torch.Tensor | None]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, h, w, c) -> this stage's map, and the next stage's input (B, h/2, w/2, 2c)."""
        padded = torch.Size(windows.whole(n, WINDOW) for n in x.shape[1:3])
        strangers = windows.strangers(padded, WINDOW, x.device)[:, None]
        penalty = torch.zeros(strangers.shape, dtype=x.dtype, device=x.device)
        penalty.masked_fill_(strangers, REGION_PENALTY)
        for block in self.blocks:
            x = block(x, penalty, next(keeps))
        return x, x if self.downsample is None else self.downsample(x)


class PatchEmbedding(nn.Module):
    """4x4 pixels -> one token."""

    def __init__(self) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, EMBED, PATCH, stride=PATCH)
        self.norm = nn.LayerNorm(EMBED)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) -> (B, H/4, W/4, 96)."""
        y: torch.Tensor = self.norm(self.proj(images).permute(0, 2, 3, 1))
        return y


class SwinBackbone(nn.Module):
    """Normalised images -> four maps of tokens.

    ``drop_path`` is the highest rate of stochastic depth; block i of n has i / (n - 1) of it, the
    linear rule of Huang et al. (ECCV 2016). It acts only in training mode, and only with a generator.
    """

    def __init__(self, drop_path: float) -> None:
        super().__init__()
        self.drop_rates = np.linspace(0.0, drop_path, sum(DEPTHS))
        self.patch_embed = PatchEmbedding()
        last = len(DEPTHS) - 1
        self.layers = nn.ModuleList(
            SwinStage(width, depth, heads, last=stage == last)
            for stage, (width, depth, heads) in enumerate(zip(WIDTHS, DEPTHS, HEADS, strict=True))
        )

    def forward(self, images: torch.Tensor, rng: np.random.Generator | None = None) -> list[torch.Tensor]:
        """(B, 3, H, W), H and W multiples of 32 -> four (B, H/s, W/s, c), s = 4, 8, 16, 32."""
        x = self.patch_embed(images)
        keeps = self._keep_factors(x, rng)
        maps = []
        for stage in self.layers:
            found, x = stage(x, keeps)
            maps.append(found)
        return maps

    def _keep_factors(
        self, x: torch.Tensor, rng: np.random.Generator | None
    ) -> Iterator[torch.Tensor | None]:
        """Per block two factors an image: 0 drops the branch, 1 / (1 - rate) makes up for it."""
        if not self.training or rng is None:
            return iter([None] * len(self.drop_rates))
        rates = self.drop_rates[:, None, None]
        # Scaled up where it is kept, so that the mean stays.
        keep = (rng.random((len(rates), 2, x.shape[0])) >= rates) / (1.0 - rates)
        return iter(torch.as_tensor(keep, dtype=x.dtype, device=x.device)[..., None, None, None].unbind(0))
