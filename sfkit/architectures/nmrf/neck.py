"""The neck of ``nmrf-swint``: a convolutional stem gathers from Swin's four levels by deformable attention.

Deformable attention (Deformable DETR, ICLR 2021) is over one level, in plain PyTorch. Every LayerNorm of the
neck has eps 1e-6, unlike the rest of the network (1e-5).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import nn

HEADS = 8
POINTS = 4
VALUE_RATIO = 0.5


class DeformableAttention(nn.Module):
    """Each query reads ``POINTS`` places a head from a value map, and weighs them.

    The places are the query's own position in the value map plus learned offsets, in pixels of the
    value map; outside the map there are zeros.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        inner = int(width * VALUE_RATIO)
        self.sampling_offsets = nn.Linear(width, HEADS * POINTS * 2)
        self.attention_weights = nn.Linear(width, HEADS * POINTS)
        self.value_proj = nn.Linear(width, inner)
        self.output_proj = nn.Linear(inner, width)

    def forward(self, queries: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
        """Queries (B, h, w, c) on one grid, values (B, h', w', c) on another -> (B, h, w, c)."""
        batch, height, width, _ = queries.shape
        grid = self._places(queries, values.shape[1:3])
        # Sampling takes values and places of one type.
        maps = self.value_proj(values).to(grid.dtype)
        maps = maps.unflatten(-1, (HEADS, -1)).permute(0, 3, 4, 1, 2).flatten(0, 1)
        samples = F.grid_sample(maps, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
        weights = self.attention_weights(queries).unflatten(-1, (HEADS, POINTS)).softmax(-1)
        weights = weights.permute(0, 3, 1, 2, 4).reshape(batch * HEADS, 1, height * width, POINTS)
        read = (samples * weights).sum(-1).reshape(batch, -1, height, width)
        y: torch.Tensor = self.output_proj(read.permute(0, 2, 3, 1))
        return y

    def _places(self, queries: torch.Tensor, value_size: torch.Size) -> torch.Tensor:
        """Sampling places (B * heads, h * w, points, xy) in -1..1, where +-1 are the map's outer edges."""
        batch, height, width, _ = queries.shape
        offsets = self.sampling_offsets(queries)
        # Half precision cannot hold a position to a fraction of a pixel.
        offsets = offsets if offsets.dtype == torch.float64 else offsets.float()
        offsets = offsets.reshape(batch, height, width, HEADS, POINTS, 2)
        x = (torch.arange(width, device=queries.device, dtype=offsets.dtype) + 0.5) / width
        y = (torch.arange(height, device=queries.device, dtype=offsets.dtype) + 0.5) / height
        across = x[:, None, None] + offsets[..., 0] / value_size[1]
        down = y[:, None, None, None] + offsets[..., 1] / value_size[0]
        # grid_sample takes -1 to 1 from edge to edge.
        places = 2 * torch.stack((across, down), -1) - 1
        return places.permute(0, 3, 1, 2, 4, 5).reshape(batch * HEADS, height * width, POINTS, 2)


EPS = 1e-6
STEM_WIDTH = 64
FFN_RATIO = 0.25


class ConvolutionStem(nn.Module):
    """Three 3x3 convolutions and a max pool: the neck's queries at 1/4 resolution."""

    def __init__(self, width: int) -> None:
        super().__init__()
        convolutions: list[nn.Module] = []
        for c_in, stride in ((3, 2), (STEM_WIDTH, 1), (STEM_WIDTH, 1)):
            conv = nn.Conv2d(c_in, STEM_WIDTH, 3, stride=stride, padding=1, bias=False)
            convolutions += [conv, nn.InstanceNorm2d(STEM_WIDTH), nn.ReLU()]
        self.stem = nn.Sequential(*convolutions, nn.MaxPool2d(3, stride=2, padding=1))
        self.fc = nn.Conv2d(STEM_WIDTH, width, 1)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) -> (B, H/4, W/4, width)."""
        y: torch.Tensor = self.fc(self.stem(images)).permute(0, 2, 3, 1)
        return y


class DepthwiseConvolution(nn.Module):
    """3x3 depthwise convolution of a token grid."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.dwconv = nn.Conv2d(width, width, 3, padding=1, groups=width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, h, w, c) -> same."""
        y: torch.Tensor = self.dwconv(x.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return y


class ConvolutionalFeedForward(nn.Module):
    """Feed-forward block that mixes neighbours between its two linear layers."""

    def __init__(self, width: int) -> None:
        super().__init__()
        hidden = int(width * FFN_RATIO)
        self.fc1 = nn.Linear(width, hidden)
        self.dwconv = DepthwiseConvolution(hidden)
        self.fc2 = nn.Linear(hidden, width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, h, w, c) -> same."""
        y: torch.Tensor = self.fc2(F.gelu(self.dwconv(self.fc1(x))))
        return y


class Extractor(nn.Module):
    """One level's contribution to the queries, pre-norm and residual."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.query_norm = nn.LayerNorm(width, eps=EPS)
        self.feat_norm = nn.LayerNorm(width, eps=EPS)
        self.attn = DeformableAttention(width)
        self.ffn = ConvolutionalFeedForward(width)
        self.ffn_norm = nn.LayerNorm(width, eps=EPS)

    def forward(self, queries: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
        """Queries (B, h, w, c), level (B, h', w', c) -> (B, h, w, c)."""
        queries = queries + self.attn(self.query_norm(queries), self.feat_norm(level))
        y: torch.Tensor = queries + self.ffn(self.ffn_norm(queries))
        return y


class DeformableNeck(nn.Module):
    """Swin's four levels and the images -> one map at 1/4 resolution."""

    def __init__(self, level_widths: Sequence[int], width: int) -> None:
        super().__init__()
        self.stem = ConvolutionStem(width)
        self.extractors = nn.ModuleList(Extractor(width) for _ in level_widths)
        self.fcs = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(c, eps=EPS), nn.Linear(c, width)) for c in level_widths
        )

    def forward(self, images: torch.Tensor, levels: Sequence[torch.Tensor]) -> torch.Tensor:
        """Images (B, 3, H, W), levels (B, H/s, W/s, c) for s = 4, 8, 16, 32 -> (B, width, H/4, W/4)."""
        queries = self.stem(images)
        for extractor, project, level in zip(self.extractors, self.fcs, levels, strict=True):
            queries = extractor(queries, project(level))
        y: torch.Tensor = queries.permute(0, 3, 1, 2)
        return y
