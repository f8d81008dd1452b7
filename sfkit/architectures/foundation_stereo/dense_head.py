"""The dense-prediction head on the vision transformer (DPT, Ranftl et al. 2021, as in Depth Anything V2)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.sizes import VitSize
from sfkit.architectures.foundation_stereo.vit import PATCH


def resize_corners(x: Tensor, size: tuple[int, int]) -> Tensor:
    """Bilinear resize of (B, C, H, W) to ``size`` whose corner pixels stay corner pixels."""
    return F.interpolate(x, size=size, mode="bilinear", align_corners=True)


class PreactResidual(nn.Module):
    """x -> x + conv(ReLU(conv(ReLU x))); the skip carries x before its activation."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, H, W) -> the same shape."""
        out: Tensor = x + self.conv2(torch.relu(self.conv1(torch.relu(x))))
        return out


class FusionStep(nn.Module):
    """Add a finer tap to the map coming from above, refine, and bring it to the next size.

    The topmost step gets no tap: its ``resConfUnit1`` takes no part, but published files hold it.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.out_conv = nn.Conv2d(channels, channels, 1)
        self.resConfUnit1 = PreactResidual(channels)
        self.resConfUnit2 = PreactResidual(channels)

    def forward(self, top: Tensor, tap: Tensor | None, size: tuple[int, int]) -> Tensor:
        """(B, channels, h, w), and a tap of that shape -> (B, channels, *size)."""
        merged = top if tap is None else top + self.resConfUnit1(tap)
        out: Tensor = self.out_conv(resize_corners(self.resConfUnit2(merged), size))
        return out


class Scratch(nn.Module):
    """The head's trunk, coarse to fine. ``output_conv2`` (the depth output) takes no part here."""

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        width, out = size.head_width, size.out_channels
        for level, channels in enumerate(size.tap_channels, start=1):
            # Numbered attributes instead of lists: these are the keys of published files.
            setattr(self, f"layer{level}_rn", nn.Conv2d(channels, width, 3, padding=1, bias=False))
            setattr(self, f"refinenet{level}", FusionStep(width))
        self.output_conv1 = nn.Conv2d(width, out, 3, padding=1)
        self.output_conv2 = nn.Sequential(nn.Conv2d(out, 32, 3, padding=1), nn.ReLU(), nn.Conv2d(32, 1, 1))

    def forward(self, taps: list[Tensor]) -> Tensor:
        """Four taps, fine to coarse, each half the size of the one before -> (B, out, 2 H_1, 2 W_1)."""
        taps = [getattr(self, f"layer{level}_rn")(tap) for level, tap in enumerate(taps, start=1)]
        path, lateral = taps[3], None
        for level in (4, 3, 2, 1):
            finer = taps[level - 2] if level > 1 else None
            # The last step meets no finer map: it doubles.
            height, width = (
                finer.shape[-2:] if finer is not None else (2 * path.shape[-2], 2 * path.shape[-1])
            )
            path = getattr(self, f"refinenet{level}")(path, lateral, (height, width))
            lateral = finer
        out: Tensor = self.output_conv1(path)
        return out


class DensePredictionHead(nn.Module):
    """Four ViT maps of one size -> one dense feature map at the resolution of the ViT's input."""

    def __init__(self, size: VitSize) -> None:
        super().__init__()
        c1, c2, _, c4 = size.tap_channels
        self.projects = nn.ModuleList(nn.Conv2d(size.width, c, 1) for c in size.tap_channels)
        self.resize_layers = nn.ModuleList(
            [
                nn.ConvTranspose2d(c1, c1, 4, stride=4),
                nn.ConvTranspose2d(c2, c2, 2, stride=2),
                nn.Identity(),
                nn.Conv2d(c4, c4, 3, stride=2, padding=1),
            ]
        )
        self.scratch = Scratch(size)

    def forward(self, maps: list[Tensor]) -> Tensor:
        """Four maps (B, width, rows, cols), shallow first -> (B, out_channels, 14 rows, 14 cols)."""
        rows, cols = maps[0].shape[-2:]
        steps = zip(maps, self.projects, self.resize_layers, strict=True)
        dense: Tensor = self.scratch([resize(project(map_)) for map_, project, resize in steps])
        return resize_corners(dense, (PATCH * rows, PATCH * cols))
