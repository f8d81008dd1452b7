"""Layers that several parts of FoundationStereo share.

Attribute names (``conv``, ``bn``, ``norm3``, ``downsample``) are those of the published checkpoints.
A normalisation without parameters, or an identity, may stand under ``bn``: it adds no key.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

NormFactory = Callable[[int], nn.Module]

LEAKY_SLOPE = 0.01


class ConvUnit(nn.Module):
    """Convolution (or transposed convolution), normalisation, leaky ReLU; any number of dimensions."""

    def __init__(self, conv: nn.Module, norm: nn.Module | None = None) -> None:
        super().__init__()
        self.conv = conv
        self.bn = norm if norm is not None else nn.Identity()
        self.activation = nn.LeakyReLU(LEAKY_SLOPE, inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C_in, ...) -> (B, C_out, ...)."""
        out: Tensor = self.activation(self.bn(self.conv(x)))
        return out


class PlainResidual(nn.Module):
    """x -> ReLU(x + norm(conv(ReLU(norm(conv x))))) with 3-wide convolutions without bias, 2-D or 3-D."""

    def __init__(self, conv: type[nn.Conv2d] | type[nn.Conv3d], norm: NormFactory, channels: int) -> None:
        super().__init__()
        self.conv1 = conv(channels, channels, 3, padding=1, bias=False)
        self.bn1 = norm(channels)
        self.conv2 = conv(channels, channels, 3, padding=1, bias=False)
        self.bn2 = norm(channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, ...) -> the same shape."""
        inner = torch.relu_(self.bn1(self.conv1(x)))
        return torch.relu_(self.bn2(self.conv2(inner)).add_(x))


class RectifiedResidual(nn.Module):
    """x -> ReLU(shortcut(x) + ReLU(norm(conv(ReLU(norm(conv x)))))): the branch is rectified before the sum.

    Where size or width changes, the shortcut is a 1x1 convolution and a normalisation. Published files
    hold that normalisation under two names, ``norm3`` and ``downsample.1``: one module, registered twice.
    """

    def __init__(self, c_in: int, c_out: int, norm: NormFactory, stride: int = 1) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(c_in, c_out, 3, stride=stride, padding=1)
        self.norm1 = norm(c_out)
        self.conv2 = nn.Conv2d(c_out, c_out, 3, padding=1)
        self.norm2 = norm(c_out)
        self.downsample: nn.Module = nn.Identity()
        if stride != 1 or c_in != c_out:
            self.norm3 = norm(c_out)
            self.downsample = nn.Sequential(nn.Conv2d(c_in, c_out, 1, stride=stride), self.norm3)

    def forward(self, x: Tensor) -> Tensor:
        """(B, c_in, H, W) -> (B, c_out, H / stride, W / stride)."""
        inner = torch.relu_(self.norm1(self.conv1(x)))
        inner = torch.relu_(self.norm2(self.conv2(inner)))
        return torch.relu_(self.downsample(x) + inner)


class UpsampleFuse(nn.Module):
    """Bring a coarse map to twice its size and fuse it with the finer map of that size."""

    def __init__(self, up: nn.Module, fuse: nn.Module) -> None:
        super().__init__()
        self.conv1 = up
        self.conv2 = fuse

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """(B, C1, H, W) and (B, C2, 2H, 2W) -> (B, C3, 2H, 2W); the coarse channels come first."""
        out: Tensor = self.conv2(torch.cat([self.conv1(coarse), fine], dim=1))
        return out


class Mlp(nn.Module):
    """Two linear layers with an exact (erf) GELU between them, over the last dimension."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(width, hidden)
        self.act = nn.GELU()
        self.fc2 = nn.Linear(hidden, width)

    def forward(self, x: Tensor) -> Tensor:
        """(..., width) -> (..., width)."""
        out: Tensor = self.fc2(self.act(self.fc1(x)))
        return out
