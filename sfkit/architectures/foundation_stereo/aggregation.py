"""Filtering the cost volume: stem, guided hourglass with a disparity transformer, first disparity.

Paper section 3.2 ("attentive hybrid cost filtering"): axial-planar convolutions split a large 3-D kernel
into one over space and one over disparity; features of the left image gate the volume's channels.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.cost_volume import VOLUME_CHANNELS
from sfkit.architectures.foundation_stereo.disparity_transformer import (
    DisparityAttention,
    DisparityTransformer,
)
from sfkit.architectures.foundation_stereo.layers import ConvUnit, PlainResidual
from sfkit.architectures.foundation_stereo.neck import FUSED, Features

FILTERED = 28  # channels of the filtered volume
AXIAL_KERNEL = 17  # extent of the axial convolution, in disparities


class FeatureGate(nn.Module):
    """Gate a volume's channels, pixel by pixel, by the left image's features."""

    def __init__(self, channels: int, feature_channels: int) -> None:
        super().__init__()
        half = feature_channels // 2
        self.feat_att = nn.Sequential(
            ConvUnit(nn.Conv2d(feature_channels, half, 1, bias=False), nn.BatchNorm2d(half)),
            nn.Conv2d(half, channels, 1),
        )

    def forward(self, volume: Tensor, features: Tensor) -> Tensor:
        """(B, channels, D, h, w) and (B, feature_channels, h, w) -> the volume's shape."""
        gate = torch.sigmoid(self.feat_att(features))
        return volume * gate[:, :, None]


class AxialConv(nn.Conv3d):
    """A (17, 1, 1) convolution, computed in 2-D over (disparity, all pixels).

    The numbers are those of the 3-D convolution; PyTorch's 3-D kernel for this shape copies the volume
    17 times when it runs on one CPU thread.
    """

    def __init__(self, channels: int) -> None:
        super().__init__(channels, channels, (AXIAL_KERNEL, 1, 1))

    def forward(self, volume: Tensor) -> Tensor:
        """(B, channels, D, h, w) -> the same shape."""
        flat = volume.flatten(3)
        out = F.conv2d(flat, self.weight.squeeze(-1), self.bias, padding=(AXIAL_KERNEL // 2, 0))
        return out.reshape(volume.shape)


class AxialPlanarConv(nn.Module):
    """A planar (1, 3, 3) and then an axial (17, 1, 1) convolution, each normalised and rectified."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Sequential(
            nn.Conv3d(channels, channels, (1, 3, 3), padding=(0, 1, 1)),
            nn.BatchNorm3d(channels),
            nn.ReLU(inplace=True),
        )
        self.conv2 = nn.Sequential(AxialConv(channels), nn.BatchNorm3d(channels), nn.ReLU(inplace=True))

    def forward(self, volume: Tensor) -> Tensor:
        """(B, channels, D, h, w) -> the same shape."""
        out: Tensor = self.conv2(self.conv1(volume))
        return out


class Hourglass(nn.Module):
    """Three halvings and three doublings of the volume, beside a transformer along disparity."""

    def __init__(self, over: DisparityAttention) -> None:
        super().__init__()
        c = FILTERED
        _, f8, f16, f32 = FUSED
        self.conv1 = _down(c, 2 * c)
        self.conv2 = _down(2 * c, 4 * c)
        self.conv3 = _down(4 * c, 6 * c)
        self.feature_att_8 = FeatureGate(2 * c, f8)
        self.feature_att_16 = FeatureGate(4 * c, f16)
        self.feature_att_32 = FeatureGate(6 * c, f32)
        self.conv3_up = _up(6 * c, 4 * c)
        self.conv2_up = _up(4 * c, 2 * c)
        self.conv1_up = _up(2 * c, c)
        self.agg_0 = _merge(4 * c)
        self.agg_1 = _merge(2 * c)
        self.feature_att_up_16 = FeatureGate(4 * c, f16)
        self.feature_att_up_8 = FeatureGate(2 * c, f8)
        self.conv_patch = nn.Sequential(nn.Conv3d(c, c, 4, stride=4, groups=c), nn.BatchNorm3d(c))
        self.atts = nn.ModuleDict({"4": DisparityTransformer(c, over)})
        self.conv_out = nn.Sequential(AxialPlanarConv(c), AxialPlanarConv(c))

    def forward(self, volume: Tensor, left: Features) -> Tensor:
        """(B, 28, D, h, w), D, h and w multiples of 8, and the left features -> the same shape."""
        x8 = self.feature_att_8(self.conv1(volume), left.eighth)
        x16 = self.feature_att_16(self.conv2(x8), left.sixteenth)
        x32 = self.feature_att_32(self.conv3(x16), left.thirtysecond)
        x16 = self.agg_0(torch.cat([self.conv3_up(x32), x16], dim=1))
        x16 = self.feature_att_up_16(x16, left.sixteenth)
        x8 = self.agg_1(torch.cat([self.conv2_up(x16), x8], dim=1))
        x8 = self.feature_att_up_8(x8, left.eighth)
        out: Tensor = self.conv_out(self.conv1_up(x8) + self._along_disparity(volume))
        return out

    def _along_disparity(self, volume: Tensor) -> Tensor:
        attended = self.atts["4"](self.conv_patch(volume))
        # Attention costs the square of the number of disparities: it works on patches of four.
        return F.interpolate(attended, scale_factor=4, mode="trilinear", align_corners=False)


def correlation_stem() -> nn.Sequential:
    """The hybrid volume (B, 32, D, h, w) -> (B, 28, D, h, w)."""
    return nn.Sequential(
        nn.Conv3d(VOLUME_CHANNELS, FILTERED, 1),
        _conv3(FILTERED, FILTERED),
        PlainResidual(nn.Conv3d, nn.BatchNorm3d, FILTERED),
        PlainResidual(nn.Conv3d, nn.BatchNorm3d, FILTERED),
    )


def classifier() -> nn.Sequential:
    """The filtered volume (B, 28, D, h, w) -> one score a disparity, (B, 1, D, h, w)."""
    half = FILTERED // 2
    return nn.Sequential(
        _conv3(FILTERED, half),
        PlainResidual(nn.Conv3d, nn.BatchNorm3d, half),
        nn.Conv3d(half, 1, 7, padding=3),
    )


def soft_argmin(scores: Tensor) -> Tensor:
    """The expected disparity under softmax(scores): (B, 1, D, h, w) -> (B, 1, h, w), 0..D-1, float32."""
    # In float32: from 64 on half has steps of 1/16.
    with torch.autocast(scores.device.type, enabled=False):
        likelihood = scores.float().softmax(dim=2)
        disparity = torch.arange(scores.shape[2], dtype=torch.float32, device=scores.device)
        return (likelihood * disparity[:, None, None]).sum(dim=2)


def _conv3(c_in: int, c_out: int, stride: int = 1) -> ConvUnit:
    conv = nn.Conv3d(c_in, c_out, 3, stride=stride, padding=1, bias=False)
    return ConvUnit(conv, nn.BatchNorm3d(c_out))


def _down(c_in: int, c_out: int) -> nn.Sequential:
    return nn.Sequential(_conv3(c_in, c_out, stride=2), AxialPlanarConv(c_out))


def _up(c_in: int, c_out: int) -> ConvUnit:
    conv = nn.ConvTranspose3d(c_in, c_out, 4, stride=2, padding=1, bias=False)
    return ConvUnit(conv, nn.BatchNorm3d(c_out))


def _merge(channels: int) -> nn.Sequential:
    conv = nn.Conv3d(2 * channels, channels, 1, bias=False)
    unit = ConvUnit(conv, nn.BatchNorm3d(channels))
    return nn.Sequential(unit, AxialPlanarConv(channels), AxialPlanarConv(channels))
