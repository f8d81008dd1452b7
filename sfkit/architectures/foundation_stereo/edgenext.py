"""The convolutional backbone: EdgeNeXt-small (Maaz et al. 2022), the trainable side of section 3.1.

Four stages at 1/4, 1/8, 1/16 and 1/32 of the image. The last layer of stages 2 to 4 is a
split-transpose layer: depthwise convolutions over chunks of channels, then attention between channels.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.layers import Mlp

WIDTHS = (48, 96, 160, 304)
DEPTHS = (3, 3, 9, 3)
KERNELS = (3, 5, 7, 9)
CHUNKS = (0, 2, 3, 4)  # of each stage's split-transpose layer; the first stage has none
POSITION_STAGE = 1  # its split-transpose layer alone adds a position code
HEADS = 8
NORM_EPS = 1e-6
SCALE_START = 1e-6


class ChannelNorm(nn.LayerNorm):
    """Layer normalisation over the channels of (B, C, H, W)."""

    def __init__(self, channels: int) -> None:
        super().__init__(channels, eps=NORM_EPS)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> the same shape."""
        return super().forward(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)


class ConvLayer(nn.Module):
    """Depthwise convolution, then an MLP over channels, added to the input."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.gamma = nn.Parameter(SCALE_START * torch.ones(channels))
        self.conv_dw = nn.Conv2d(channels, channels, kernel, padding=kernel // 2, groups=channels)
        self.norm = nn.LayerNorm(channels, eps=NORM_EPS)
        self.mlp = Mlp(channels, 4 * channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, H, W) -> the same shape."""
        y = self.conv_dw(x).permute(0, 2, 3, 1)
        y = self.gamma * self.mlp(self.norm(y))
        out: Tensor = x + y.permute(0, 3, 1, 2)
        return out


class FourierPosition(nn.Module):
    """Sines and cosines of row and column (16 frequencies each), projected to the stage's width."""

    frequencies = 16
    temperature = 10000.0

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.token_projection = nn.Conv2d(4 * self.frequencies, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """The code for maps of x's height and width, (1, channels, H, W)."""
        rows, cols = x.shape[-2:]
        y_code = self._waves(rows, x)[:, :, None].expand(-1, -1, cols)
        x_code = self._waves(cols, x)[:, None, :].expand(-1, rows, -1)
        out: Tensor = self.token_projection(torch.cat([y_code, x_code])[None])
        return out

    def _waves(self, count: int, like: Tensor) -> Tensor:
        steps = torch.arange(1, count + 1, dtype=torch.float32, device=like.device)
        angle = 2 * math.pi * steps / (count + 1e-6)
        powers = torch.arange(self.frequencies, dtype=torch.float32, device=like.device) / self.frequencies
        phase = angle / torch.pow(self.temperature, powers)[:, None]
        return torch.stack([phase.sin(), phase.cos()], dim=1).flatten(0, 1)


class CrossCovariance(nn.Module):
    """Attention between the channels of each head: queries and keys are normalised along the tokens."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.temperature = nn.Parameter(torch.ones(HEADS, 1, 1))
        self.qkv = nn.Linear(channels, 3 * channels)
        self.proj = nn.Linear(channels, channels)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, N, channels) -> (B, N, channels)."""
        batch, count, channels = tokens.shape
        qkv = self.qkv(tokens).view(batch, count, 3, HEADS, channels // HEADS)
        q, k, v = qkv.permute(2, 0, 3, 4, 1).unbind(0)
        scores = F.normalize(q, dim=-1) @ F.normalize(k, dim=-1).transpose(-1, -2)
        mixed = (scores * self.temperature).softmax(dim=-1) @ v
        out: Tensor = self.proj(mixed.permute(0, 3, 1, 2).reshape(batch, count, channels))
        return out


class SplitTransposeLayer(nn.Module):
    """Chunks of channels pass depthwise convolutions in a cascade, then channels attend to each other."""

    def __init__(self, channels: int, chunks: int, position: bool) -> None:
        super().__init__()
        # The last piece may be narrower, and is passed on as it is.
        self.chunk = math.ceil(channels / chunks)
        self.convs = nn.ModuleList(
            nn.Conv2d(self.chunk, self.chunk, 3, padding=1, groups=self.chunk) for _ in range(chunks - 1)
        )
        self.pos_embd = FourierPosition(channels) if position else None
        self.norm_xca = nn.LayerNorm(channels, eps=NORM_EPS)
        self.gamma_xca = nn.Parameter(SCALE_START * torch.ones(channels))
        self.xca = CrossCovariance(channels)
        self.norm = nn.LayerNorm(channels, eps=NORM_EPS)
        self.mlp = Mlp(channels, 4 * channels)
        self.gamma = nn.Parameter(SCALE_START * torch.ones(channels))

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, H, W) -> the same shape."""
        mixed = self._cascade(x)
        if self.pos_embd is not None:
            mixed = mixed + self.pos_embd(mixed)
        tokens = mixed.flatten(2).transpose(1, 2)
        tokens = tokens + self.gamma_xca * self.xca(self.norm_xca(tokens))
        update = self.gamma * self.mlp(self.norm(tokens))
        out: Tensor = x + update.transpose(1, 2).reshape(x.shape)
        return out

    def _cascade(self, x: Tensor) -> Tensor:
        *convolved, untouched = torch.split(x, self.chunk, dim=1)
        out: list[Tensor] = []
        for conv, part in zip(self.convs, convolved, strict=True):
            out.append(conv(part + out[-1] if out else part))
        return torch.cat([*out, untouched], dim=1)


class EdgeNeXtStage(nn.Module):
    """One resolution: halve the size (but for the first stage), then the stage's layers."""

    def __init__(self, index: int) -> None:
        super().__init__()
        width, depth, kernel, chunks = WIDTHS[index], DEPTHS[index], KERNELS[index], CHUNKS[index]
        self.downsample: nn.Module = nn.Identity()
        if index > 0:
            before = WIDTHS[index - 1]
            self.downsample = nn.Sequential(ChannelNorm(before), nn.Conv2d(before, width, 2, stride=2))
        layers: list[nn.Module] = [ConvLayer(width, kernel) for _ in range(depth - (chunks > 0))]
        if chunks:
            layers.append(SplitTransposeLayer(width, chunks, position=index == POSITION_STAGE))
        self.blocks = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C_before, H, W) -> (B, C, H / 2, W / 2); the first stage keeps the size."""
        out: Tensor = self.blocks(self.downsample(x))
        return out


def edgenext_stem() -> nn.Sequential:
    """Images (B, 3, H, W) -> (B, 48, H / 4, W / 4)."""
    return nn.Sequential(nn.Conv2d(3, WIDTHS[0], 4, stride=4), ChannelNorm(WIDTHS[0]))


def edgenext_stages() -> nn.ModuleList:
    """The four stages, fine to coarse."""
    return nn.ModuleList(EdgeNeXtStage(index) for index in range(len(WIDTHS)))
