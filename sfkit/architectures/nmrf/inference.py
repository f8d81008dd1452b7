"""Neural MRF inference at 1/8 resolution (NMRF, CVPR 2024)."""

from __future__ import annotations

import torch

from sfkit.architectures.nmrf.disparity_code import EIGHTH_UNIT, disparity_code
from sfkit.architectures.nmrf.matching import MatchingFeatures
from sfkit.architectures.nmrf.messages import MessageStack

WINDOW = 6
LAYERS = 5


class Inference(MessageStack):
    """Candidate disparities weigh each other against the images and against their neighbours."""

    def __init__(self, width: int, candidates: int) -> None:
        super().__init__(width, WINDOW, LAYERS, candidates)

    def forward(self, labels: torch.Tensor, features: MatchingFeatures) -> list[torch.Tensor]:
        """Labels (B, h, w, N) in units of 1/8 px -> tokens (B, h, w, N, c), one a layer in training."""
        code = disparity_code(labels, EIGHTH_UNIT)
        return self.pass_messages(features.unary(labels), code)
