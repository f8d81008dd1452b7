"""The recurrent update: three coupled selective GRUs and the disparity head (paper section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.context import HIDDEN
from sfkit.architectures.foundation_stereo.lookup import LOOKUP_CHANNELS

MASK_CHANNELS = 32

Scales = tuple[Tensor, Tensor, Tensor]


class Update(NamedTuple):
    """One step of the recurrence.

    Attributes:
        hidden: the new hidden states at 1/4, 1/8 and 1/16, (B, 128, ., .) each.
        mask: (B, 32, h, w), what the upsampling weights are made from.
        step: (B, 1, h, w), to be added to the disparity, in quarter-resolution pixels.
    """

    hidden: Scales
    mask: Tensor
    step: Tensor


class MotionEncoder(nn.Module):
    """Disparity and the evidence around it, as 128 channels; the last is the disparity itself."""

    def __init__(self) -> None:
        super().__init__()
        self.convc1 = nn.Conv2d(LOOKUP_CHANNELS, 256, 1)
        self.convc2 = nn.Conv2d(256, 256, 3, padding=1)
        self.convd1 = nn.Conv2d(1, 64, 7, padding=3)
        self.convd2 = nn.Conv2d(64, 64, 3, padding=1)
        self.conv = nn.Conv2d(256 + 64, HIDDEN - 1, 3, padding=1)

    def forward(self, disparity: Tensor, evidence: Tensor) -> Tensor:
        """(B, 1, h, w) in quarter-resolution pixels and (B, 522, h, w) -> (B, 128, h, w)."""
        evidence = torch.relu(self.convc2(torch.relu(self.convc1(evidence))))
        shape = torch.relu(self.convd2(torch.relu(self.convd1(disparity))))
        joined = torch.relu(self.conv(torch.cat([evidence, shape], dim=1)))
        # The disparity itself goes with it: the GRU is to know where it stands, not only what lies around.
        return torch.cat([joined, disparity], dim=1)


class GruBranch(nn.Module):
    """A convolutional GRU cell of one kernel size."""

    def __init__(self, joined: int, kernel: int) -> None:
        super().__init__()
        self.convz = nn.Conv2d(joined, HIDDEN, kernel, padding=kernel // 2)
        self.convr = nn.Conv2d(joined, HIDDEN, kernel, padding=kernel // 2)
        self.convq = nn.Conv2d(joined, HIDDEN, kernel, padding=kernel // 2)

    def forward(self, hidden: Tensor, x: Tensor, joined: Tensor) -> Tensor:
        """Hidden state (B, 128, h, w), input x, and the mixture of both -> the new hidden state."""
        update = torch.sigmoid(self.convz(joined))
        reset = torch.sigmoid(self.convr(joined))
        candidate = torch.tanh(self.convq(torch.cat([reset * hidden, x], dim=1)))
        return torch.lerp(hidden, candidate, update)


class SelectiveGru(nn.Module):
    """A GRU with a small and a large kernel, blended pixel by pixel (Selective-Stereo, Wang et al. 2024)."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        joined = inputs + HIDDEN
        self.conv0 = nn.Sequential(nn.Conv2d(inputs, inputs, 3, padding=1), nn.ReLU())
        self.conv1 = nn.Sequential(nn.Conv2d(joined, joined, 3, padding=1), nn.ReLU())
        self.small_gru = GruBranch(joined, 1)
        self.large_gru = GruBranch(joined, 3)

    def forward(self, attention: Tensor, hidden: Tensor, *inputs: Tensor) -> Tensor:
        """Attention (B, 1, h, w), hidden state and inputs of that size -> the new hidden state."""
        x = self.conv0(torch.cat(inputs, dim=1))
        joined = self.conv1(torch.cat([x, hidden], dim=1))
        small = self.small_gru(hidden, x, joined)
        large = self.large_gru(hidden, x, joined)
        return torch.lerp(large, small, attention)


class StepLayer(nn.Module):
    """ConvNeXt layer (Liu et al. 2022) without its normalisation."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        # A layer begins as nearly the identity (layer scale, Touvron et al. 2021).
        self.gamma = nn.Parameter(1e-6 * torch.ones(channels))
        self.dwconv = nn.Conv2d(channels, channels, 7, padding=3, groups=channels)
        self.pwconv1 = nn.Linear(channels, 4 * channels)
        self.pwconv2 = nn.Linear(4 * channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, h, w) -> the same shape."""
        y = self.dwconv(x).permute(0, 2, 3, 1)
        y = self.gamma * self.pwconv2(F.gelu(self.pwconv1(y)))
        out: Tensor = x + y.permute(0, 3, 1, 2)
        return out


class DisparityHead(nn.Module):
    """The finest hidden state to a disparity step."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Sequential(
            nn.Conv2d(HIDDEN, HIDDEN, 3, padding=1),
            nn.ReLU(),
            StepLayer(HIDDEN),
            StepLayer(HIDDEN),
            nn.Conv2d(HIDDEN, 1, 3, padding=1),
        )

    def forward(self, hidden: Tensor) -> Tensor:
        """(B, 128, h, w) -> (B, 1, h, w), quarter-resolution pixels."""
        step: Tensor = self.conv(hidden)
        return step


class UpdateBlock(nn.Module):
    """One iteration, coarse to fine: the GRUs at 1/16, 1/8 and 1/4, then the step and the mask."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = MotionEncoder()
        self.gru16 = SelectiveGru(2 * HIDDEN)
        self.gru08 = SelectiveGru(3 * HIDDEN)
        self.gru04 = SelectiveGru(3 * HIDDEN)
        self.disp_head = DisparityHead()
        self.mask = nn.Sequential(
            nn.Conv2d(HIDDEN, 64, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(64, MASK_CHANNELS, 3, padding=1),
            nn.ReLU(),
        )

    def forward(
        self, hidden: Scales, context: Scales, attention: Scales, evidence: Tensor, disparity: Tensor
    ) -> Update:
        """One step; the three-fold arguments are ordered 1/4, 1/8, 1/16.

        Args:
            hidden: hidden states, (B, 128, ., .) each.
            context: gated context maps of the same shapes.
            attention: (B, 1, ., .) each, in (0, 1): the share of the small kernel.
            evidence: (B, 522, h, w) from the geometry lookup.
            disparity: (B, 1, h, w) in quarter-resolution pixels.
        """
        fine, middle, coarse = hidden
        coarse = self.gru16(attention[2], coarse, context[2], _halve(middle))
        middle = self.gru08(attention[1], middle, context[1], _halve(fine), _double(coarse, middle))
        motion = self.encoder(disparity, evidence)
        fine = self.gru04(attention[0], fine, context[0], motion, _double(middle, fine))
        # RAFT's factor on the mask (Teed and Deng 2020), which published weights were trained with.
        return Update((fine, middle, coarse), 0.25 * self.mask(fine), self.disp_head(fine))


def _halve(x: Tensor) -> Tensor:
    return F.avg_pool2d(x, 3, stride=2, padding=1)


def _double(x: Tensor, like: Tensor) -> Tensor:
    return F.interpolate(x, size=like.shape[-2:], mode="bilinear", align_corners=True)
