"""The disparity proposal network: four refined disparities a pixel at 1/8 resolution."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf.cost_volume import GROUPS, cost_volume
from sfkit.architectures.nmrf.matching import projection
from sfkit.architectures.nmrf.perceptron import Head
from sfkit.architectures.nmrf.propagation import Propagation
from sfkit.architectures.nmrf.seeds import pick_seeds

CONTEXT_WIDTH = 64


@dataclass(frozen=True)
class Proposals:
    """What the proposal network hands over.

    Attributes:
        labels: (B, h, w, N) refined proposals in units of 1/8 px, at least 0, in the seeds' order.
        seeds: (B, h, w, N) int64 bins, units of 1/8 px, likeliest first.
        prob: (B, h, w, D) probability of each bin.
    """

    labels: torch.Tensor
    seeds: torch.Tensor
    prob: torch.Tensor


class ProposalNetwork(nn.Module):
    """Cost volume -> bin probabilities -> seeds -> propagated labels."""

    def __init__(self, features: int, width: int, bins: int, candidates: int) -> None:
        super().__init__()
        self.bins = bins
        self.candidates = candidates
        self.mlp = nn.Sequential(
            nn.Conv1d(GROUPS, 2 * GROUPS, 5, padding=2),
            nn.ReLU(),
            nn.Conv1d(2 * GROUPS, 4 * GROUPS, 5, padding=2),
            nn.ReLU(),
            nn.Conv1d(4 * GROUPS, 1, 5, padding=2),
        )
        self.proj = projection(features, width, CONTEXT_WIDTH)
        self.propagation = Propagation(width, CONTEXT_WIDTH, GROUPS)
        self.prop_head = Head(width, 1)

    def forward(
        self, left: torch.Tensor, right: torch.Tensor, seeds: torch.Tensor | None = None
    ) -> Proposals:
        """Encoder features (B, F, h, w) at 1/8 resolution -> proposals.

        Given ``seeds`` (B, h, w, N) replace those the probabilities suggest.
        """
        cost = cost_volume(left, right, self.bins)
        batch, height, width = cost.shape[:3]
        logits = self.mlp(cost.flatten(0, 2)).reshape(batch, height, width, self.bins)
        # Probabilities are compared for equality when seeds are picked: half precision would make ties.
        prob = logits.softmax(-1, dtype=torch.promote_types(logits.dtype, torch.float32))
        seeds = pick_seeds(prob, self.candidates) if seeds is None else seeds.long()
        context = self.proj(left).permute(0, 2, 3, 1)
        offset = self.prop_head(self.propagation(seeds, cost, context)).squeeze(-1)
        return Proposals(F.relu(seeds.to(prob.dtype) + offset), seeds, prob)
