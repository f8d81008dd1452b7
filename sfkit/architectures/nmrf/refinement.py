"""Refinement at 1/4 resolution: the same messages with one candidate a pixel."""

from __future__ import annotations

import torch

from sfkit.architectures.nmrf.disparity_code import QUARTER_UNIT, disparity_code
from sfkit.architectures.nmrf.matching import MatchingFeatures
from sfkit.architectures.nmrf.messages import MessageStack

WINDOW = 4
LAYERS = 5


class Refinement(MessageStack):
    """The chosen disparity of each pixel is compared with its neighbours' at twice the resolution."""

    def __init__(self, width: int) -> None:
        super().__init__(width, WINDOW, LAYERS, candidates=1)

    def forward(self, disparity: torch.Tensor, features: MatchingFeatures) -> list[torch.Tensor]:
        """Disparity (B, h, w) in units of 1/4 px -> tokens (B, h, w, c), one a layer in training."""
        candidates = disparity[..., None]
        code = disparity_code(candidates, QUARTER_UNIT)
        tokens = self.pass_messages(features.unary(candidates), code)
        return [layer.squeeze(-2) for layer in tokens]
