"""The context network: what the recurrent update reads from the left image alone (paper section 3.3).

Three scales (1/4, 1/8, 1/16), each with a map that starts the hidden state and a map of context.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.layers import ConvUnit, RectifiedResidual

HIDDEN = 128  # channels of hidden states and context maps at every scale

ContextPair = tuple[Tensor, Tensor]


class ContextNetwork(nn.Module):
    """Left image and its monocular features to three pairs (hidden, context) of 128 channels.

    ``down`` and ``norm`` take no part in inference; published files hold them.
    """

    def __init__(self, monocular_channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, padding=3)
        self.norm1 = nn.BatchNorm2d(64)
        self.layer1 = _pair(64, 64, 1)
        self.layer2 = _pair(64, 96, 2)
        self.layer3 = _pair(96, HIDDEN, 2)
        joined = HIDDEN + monocular_channels
        self.conv2 = ConvUnit(nn.Conv2d(joined, HIDDEN, 3, padding=1, bias=False), nn.BatchNorm2d(HIDDEN))
        self.layer4 = _pair(HIDDEN, HIDDEN, 2)
        self.layer5 = _pair(HIDDEN, HIDDEN, 2)
        self.outputs04 = nn.ModuleList(_output(residual=True) for _ in range(2))
        self.outputs08 = nn.ModuleList(_output(residual=True) for _ in range(2))
        self.outputs16 = nn.ModuleList(_output(residual=False) for _ in range(2))
        self.down = nn.Sequential(nn.Conv2d(HIDDEN, HIDDEN, 4, stride=4), nn.BatchNorm2d(HIDDEN))
        self.norm = nn.BatchNorm2d(2 * HIDDEN)

    def forward(self, left: Tensor, monocular: Tensor) -> tuple[ContextPair, ContextPair, ContextPair]:
        """The pairs at 1/4, 1/8 and 1/16, before tanh and ReLU.

        Args:
            left: the normalised left image, (B, 3, H, W).
            monocular: its monocular features, (B, V, H / 4, W / 4).
        """
        x = torch.relu_(self.norm1(self.conv1(left)))
        x = self.layer3(self.layer2(self.layer1(x)))
        quarter = self.conv2(torch.cat([x, monocular], dim=1))
        eighth = self.layer4(quarter)
        sixteenth = self.layer5(eighth)
        return (
            (self.outputs04[0](quarter), self.outputs04[1](quarter)),
            (self.outputs08[0](eighth), self.outputs08[1](eighth)),
            (self.outputs16[0](sixteenth), self.outputs16[1](sixteenth)),
        )


class ChannelAttention(nn.Module):
    """One factor in (0, 1) a channel, from its mean and its maximum over the map."""

    def __init__(self, channels: int = HIDDEN, squeezed: int = 8) -> None:
        super().__init__()
        self.fc = nn.Sequential(
            nn.Conv2d(channels, squeezed, 1, bias=False),
            nn.ReLU(),
            nn.Conv2d(squeezed, channels, 1, bias=False),
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, H, W) -> (B, channels, 1, 1)."""
        mean, largest = x.mean(dim=(2, 3), keepdim=True), x.amax(dim=(2, 3), keepdim=True)
        return torch.sigmoid(self.fc(mean) + self.fc(largest))


class SpatialAttention(nn.Module):
    """One factor in (0, 1) a pixel, from the mean and the maximum over channels."""

    def __init__(self) -> None:
        super().__init__()
        self.samconv = nn.Conv2d(2, 1, 7, padding=3, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, 1, H, W)."""
        pooled = torch.cat([x.mean(dim=1, keepdim=True), x.amax(dim=1, keepdim=True)], dim=1)
        return torch.sigmoid(self.samconv(pooled))


def _pair(c_in: int, c_out: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        RectifiedResidual(c_in, c_out, nn.BatchNorm2d, stride),
        RectifiedResidual(c_out, c_out, nn.BatchNorm2d),
    )


def _output(residual: bool) -> nn.Module:
    conv = nn.Conv2d(HIDDEN, HIDDEN, 3, padding=1)
    return nn.Sequential(RectifiedResidual(HIDDEN, HIDDEN, nn.BatchNorm2d), conv) if residual else conv
