"""The vision transformer of the frozen monocular branch (DINOv2, Oquab et al. 2023; no register tokens).

The layers follow DINOv2; what is peculiar is how the position grid is resampled, see ``position_codes``.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.layers import Mlp
from sfkit.architectures.foundation_stereo.sizes import VitSize

PATCH = 14
GRID = 37  # the stored position grid: a 518-pixel square of 14-pixel patches
NORM_EPS = 1e-6


class Attention(nn.Module):
    """Multi-head self-attention over all tokens; one linear layer gives [queries | keys | values]."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(B, N, width) -> (B, N, width)."""
        batch, count, width = x.shape
        qkv = self.qkv(x).view(batch, count, 3, self.heads, width // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4).unbind(0)
        mixed = F.scaled_dot_product_attention(q, k, v)
        out: Tensor = self.proj(mixed.transpose(1, 2).reshape(batch, count, width))
        return out


class LayerScale(nn.Module):
    """A learned factor a channel."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.gamma = nn.Parameter(torch.ones(width))

    def forward(self, x: Tensor) -> Tensor:
        """(..., width) -> (..., width)."""
        return x * self.gamma


class ViTLayer(nn.Module):
    """One pre-norm transformer layer with layer scales."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(width, eps=NORM_EPS)
        self.attn = Attention(width, heads)
        self.ls1 = LayerScale(width)
        self.norm2 = nn.LayerNorm(width, eps=NORM_EPS)
        self.mlp = Mlp(width, 4 * width)
        self.ls2 = LayerScale(width)

    def forward(self, x: Tensor) -> Tensor:
        """(B, N, width) -> (B, N, width)."""
        x = x + self.ls1(self.attn(self.norm1(x)))
        out: Tensor = x + self.ls2(self.mlp(self.norm2(x)))
        return out


class PatchEmbed(nn.Module):
    """One token a patch of 14 x 14 pixels, row by row."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, width, PATCH, stride=PATCH)

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, 14 rows, 14 cols) -> (B, rows * cols, width)."""
        tokens: Tensor = self.proj(images)
        return tokens.flatten(2).transpose(1, 2)


class VisionTransformer(nn.Module):
    """Images to the token maps of four layers.

    ``mask_token`` takes no part in inference; published files hold it, so it is kept.
    """

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        self.taps = size.taps
        self.cls_token = nn.Parameter(torch.zeros(1, 1, size.width))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + GRID * GRID, size.width))
        self.mask_token = nn.Parameter(torch.zeros(1, size.width))
        self.patch_embed = PatchEmbed(size.width)
        self.blocks = nn.ModuleList(ViTLayer(size.width, size.heads) for _ in range(size.depth))
        self.norm = nn.LayerNorm(size.width, eps=NORM_EPS)
        nn.init.trunc_normal_(self.pos_embed, std=0.02)

    def position_codes(self, rows: int, cols: int) -> Tensor:
        """Position codes of the class token and a rows x cols grid, (1, 1 + rows * cols, width).

        The stored grid is resampled bicubically by the factors (rows + 0.1) / 37 and (cols + 0.1) / 37,
        and positions are computed from these factors, not from the sizes: with the sizes alone the
        disparity changes by several pixels (measured on random weights).
        """
        grid = self.pos_embed[:, 1:].view(1, GRID, GRID, -1).permute(0, 3, 1, 2)
        if (rows, cols) != (GRID, GRID):
            # A trace counts in tensors, whose float32 would round what counts here.
            # A tenth of a patch more, as DINOv2 has it: rounding down must lose no row.
            factors = tuple((int(n) + 0.1) / GRID for n in (rows, cols))
            grid = F.interpolate(grid, scale_factor=factors, mode="bicubic")
        return torch.cat([self.pos_embed[:, :1], grid.flatten(2).transpose(1, 2)], dim=1)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Normalised images (B, 3, 14 rows, 14 cols) -> four maps (B, width, rows, cols), shallow first."""
        rows, cols = images.shape[-2] // PATCH, images.shape[-1] // PATCH
        x = torch.cat([self.cls_token.expand(len(images), -1, -1), self.patch_embed(images)], dim=1)
        x = x + self.position_codes(rows, cols)
        maps = []
        for index, layer in enumerate(self.blocks):
            x = layer(x)
            if index in self.taps:
                # Without the class token, which has no place.
                tokens = self.norm(x)[:, 1:]
                maps.append(tokens.transpose(1, 2).unflatten(2, (rows, cols)))
        return maps
