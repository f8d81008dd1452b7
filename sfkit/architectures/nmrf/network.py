"""NMRF: neural Markov random field stereo (Guan et al., CVPR 2024).

    images ─► encoder ─► 1/8 ─► cost volume ─► seeds ─► propagation ─► 4 labels a pixel
                  │       └──────────────────────────────► inference ─► coarse disparity
                  └────► 1/4 ────────────────────────────► refinement ─► disparity

Disparities change unit on the way: seeds and labels are in units of 1/8 px (one unit is 8 px of the
image), the refinement's in 1/4 px, the output in px.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf.inference import Inference, Refinement
from sfkit.architectures.nmrf.layers import Head, lower_median, spread, winner
from sfkit.architectures.nmrf.matching import CONCAT_WIDTH, GROUP_WIDTH, MatchingFeatures, projection
from sfkit.architectures.nmrf.proposals import STRIDE, ProposalNetwork
from sfkit.errors import InputError

WIDTH = 128
CANDIDATES = 4
REFINE_STRIDE = 4
SCORE_SCALE = 0.25


@dataclass(frozen=True)
class Coarse:
    """One inference layer's output for each pixel of the image.

    Attributes:
        disp_pred: (B, H, W, N) candidate disparities in units of 1/8 px, at least 0.
        logits_pred: (B, H, W, N) their scores.
    """

    disp_pred: torch.Tensor
    logits_pred: torch.Tensor


@dataclass(frozen=True)
class NMRFOutput:
    """All outputs of one pass; h = H / 8 and w = W / 8.

    Attributes:
        disp: (B, H, W) disparity in pixels, at least 0, without an upper limit.
        disp_pred: (B, H, W) the same in units of 1/4 px.
        proposal: (B, h * w, N) refined labels in units of 1/8 px, pixels row by row.
        initial_proposal: (B, h * w, N) the seeds they came from: whole bins, as floats.
        prob: (B * h * w, D) probability of each disparity bin.
        aux_coarse: in training one entry an inference layer, else empty.
        aux_refined: in training the earlier refinement layers' (B, H, W) in units of 1/4 px, else empty.
    """

    disp: torch.Tensor
    disp_pred: torch.Tensor
    proposal: torch.Tensor
    initial_proposal: torch.Tensor
    prob: torch.Tensor
    aux_coarse: tuple[Coarse, ...] = ()
    aux_refined: tuple[torch.Tensor, ...] = ()


class NMRF(nn.Module):
    """The network around an image encoder.

    Initial weights are PyTorch's defaults: the network is made to be loaded from a checkpoint.

    Args:
        encoder: images (B, 3, H, W) -> features (B, ``features``, H/4, W/4).
        encoder_name: the encoder's prefix in the state dict.
        features: F, channels of the encoder's output.
        multiple: what H and W must be divisible by.
        max_disp: upper end of the seeds' range, in pixels; results may exceed it.
    """

    def __init__(
        self, encoder: nn.Module, encoder_name: str, features: int, multiple: int, max_disp: int
    ) -> None:
        super().__init__()
        self.encoder_name = encoder_name
        self.multiple = multiple
        # Published files hold it; it is empty, and nothing reads it.
        self.register_buffer("device_indicator_tensor", torch.empty(0))
        self.concatconv = projection(features, WIDTH, CONCAT_WIDTH)
        self.gw = projection(features, WIDTH, GROUP_WIDTH)
        self.inference = Inference(WIDTH, CANDIDATES)
        self.infer_head = Head(WIDTH, STRIDE**2)
        self.infer_score_head = nn.Linear(WIDTH, STRIDE**2)
        self.refinement = Refinement(WIDTH)
        self.refine_head = Head(WIDTH, REFINE_STRIDE**2)
        self.dpn = ProposalNetwork(features, WIDTH, max_disp // STRIDE, CANDIDATES)
        self.add_module(encoder_name, encoder)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """Images (B, 3, H, W) -> the left image's disparity (B, H, W) in pixels, at least 0."""
        return self.estimate(left, right).disp

    def estimate(
        self,
        left: torch.Tensor,
        right: torch.Tensor,
        *,
        seeds: torch.Tensor | None = None,
        rng: np.random.Generator | None = None,
    ) -> NMRFOutput:
        """One pass with everything it produces; in training mode with the layers' auxiliary outputs.

        Args:
            left: (B, 3, H, W) RGB, in the range of the input convention; H, W multiples of ``multiple``.
            right: the same of the right image.
            seeds: (B, H/8 * W/8, N) bins to start from instead of the network's own.
            rng: draws stochastic depth in training mode (Swin-T only); without it nothing is dropped.

        Raises:
            InputError: the images' or the seeds' shape does not fit, or a seed is no bin.
        """
        self._check_images(left, right)
        quarter_left, quarter_right = self._encode(torch.cat((left, right)), rng).chunk(2)
        # Pooled, not encoded again: what is matched at 1/8 are the features of 1/4.
        eighth_left, eighth_right = (F.avg_pool2d(f, 2) for f in (quarter_left, quarter_right))
        grid = None if seeds is None else self._seed_grid(seeds, eighth_left)
        proposals = self.dpn(eighth_left, eighth_right, grid)

        features = MatchingFeatures.from_encoder(self.concatconv, self.gw, eighth_left, eighth_right)
        # What proposes labels has a loss of its own; inference learns from labels as they are.
        labels = proposals.labels.detach()
        coarse = [self._coarse(labels, tokens) for tokens in self.inference(labels, features)]
        # Candidates are in pixels of 1/8; what follows works at 1/4.
        best = winner(coarse[-1].disp_pred, coarse[-1].logits_pred) * (STRIDE / REFINE_STRIDE)
        start = lower_median(best, REFINE_STRIDE).detach()

        features = MatchingFeatures.from_encoder(self.concatconv, self.gw, quarter_left, quarter_right)
        refined = [self._refined(start, tokens) for tokens in self.refinement(start, features)]
        return NMRFOutput(
            disp=refined[-1] * REFINE_STRIDE,
            disp_pred=refined[-1],
            proposal=proposals.labels.flatten(1, 2),
            initial_proposal=proposals.seeds.flatten(1, 2).to(proposals.labels.dtype),
            prob=proposals.prob.flatten(0, 2),
            aux_coarse=tuple(coarse) if self.training else (),
            aux_refined=tuple(refined[:-1]),
        )

    def _encode(self, images: torch.Tensor, rng: np.random.Generator | None) -> torch.Tensor:
        features: torch.Tensor = self.get_submodule(self.encoder_name)(images, rng)
        return features

    def _coarse(self, labels: torch.Tensor, tokens: torch.Tensor) -> Coarse:
        """Labels (B, h, w, N) and tokens (B, h, w, N, c) -> disparities and scores at image resolution."""
        disparity = F.relu(labels[..., None] + self.infer_head(tokens))
        score = SCORE_SCALE * self.infer_score_head(tokens)
        return Coarse(spread(disparity, STRIDE), spread(score, STRIDE))

    def _refined(self, start: torch.Tensor, tokens: torch.Tensor) -> torch.Tensor:
        """Disparity (B, H/4, W/4) and tokens (B, H/4, W/4, c) -> (B, H, W), all in units of 1/4 px."""
        disparity = F.relu(start[..., None] + self.refine_head(tokens))
        return spread(disparity[..., None, :], REFINE_STRIDE).squeeze(-1)

    def _check_images(self, left: torch.Tensor, right: torch.Tensor) -> None:
        if left.shape != right.shape or left.ndim != 4 or left.shape[1] != 3:
            raise InputError(
                f"left and right image are {tuple(left.shape)} and {tuple(right.shape)}, expected the same "
                "(B, 3, H, W) twice: stack the pairs of one size"
            )
        height, width = left.shape[2:]
        if height % self.multiple or width % self.multiple:
            raise InputError(
                f"the images are {height} x {width}, expected multiples of {self.multiple}: "
                "pad them with the architecture's input convention"
            )

    def _seed_grid(self, seeds: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        """(B, h * w, N) -> (B, h, w, N) int64."""
        batch, _, height, width = features.shape
        expected = (batch, height * width, CANDIDATES)
        if tuple(seeds.shape) != expected:
            raise InputError(f"seeds are {tuple(seeds.shape)}, expected {expected}: give {CANDIDATES} each")
        bins = self.dpn.bins
        if int(seeds.min()) < 0 or int(seeds.max()) >= bins:
            raise InputError(
                f"seeds range from {seeds.min()} to {seeds.max()}, expected bins of 0 .. {bins - 1} (of 8 px)"
            )
        return seeds.reshape(batch, height, width, CANDIDATES).long()
