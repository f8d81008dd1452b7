"""The disparity proposal network: four refined disparities a pixel at 1/8 resolution.

Group-wise correlation gives each bin of 8 px a probability; the likeliest bins are seeds, which messages
along rows and columns (``propagation``) refine to labels.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf.layers import Head
from sfkit.architectures.nmrf.matching import projection
from sfkit.architectures.nmrf.propagation import Propagation

GROUPS = 4
STRIDE = 8  # one disparity bin is eight pixels


def cost_volume(left: torch.Tensor, right: torch.Tensor, bins: int) -> torch.Tensor:
    """Mean product of the features of (x, y) on the left and (x - d, y) on the right, by channel group.

    Args:
        left: (B, F, h, w) features at 1/8 resolution.
        right: the same of the right image.
        bins: D, the number of disparities d = 0 .. D - 1, in units of 1/8 px (8 px of the image).

    Returns:
        (B, h, w, G, D); exactly 0 where x < d.
    """
    batch, channels, height, width = left.shape
    # All pairs of one row at once: a matrix product is cheaper than D shifted products, and small.
    shape = (batch, GROUPS, channels // GROUPS, height, width)
    a = left.reshape(shape).permute(0, 3, 1, 4, 2)
    b = right.reshape(shape).permute(0, 3, 1, 2, 4)
    pairs = (a @ b) / (channels // GROUPS)
    x = torch.arange(width, device=left.device)
    matching = x[:, None] - torch.arange(bins, device=left.device)[None, :]
    # No column matches where x < d: any is read, and the cost is set to 0 below.
    index = matching.clamp(min=0).expand(*pairs.shape[:3], width, bins)
    cost = pairs.gather(-1, index).masked_fill(matching < 0, 0.0)
    return cost.transpose(2, 3)


SUPPRESSED = 1e-3


def pick_seeds(prob: torch.Tensor, count: int) -> torch.Tensor:
    """Probabilities (..., D) -> the ``count`` seeds (..., count) int64, in units of 1/8 px, likeliest first.

    Bins that are no local maximum and exceed 1e-3 are set to exactly 1e-3, so plateaus survive whole
    and smaller bins rank below the suppressed ones. Ties are the rule where a pixel has fewer maxima
    than ``count``: the smaller disparity comes first, on every device and in exported files. NMRF takes
    ``torch.topk``, which does not define their order.
    """
    with torch.no_grad():
        flat = prob.reshape(-1, 1, prob.shape[-1])
        peak = F.max_pool1d(flat, 3, stride=1, padding=1).reshape(prob.shape)
        # What is no local maximum: else a peak's neighbours would take the places of other peaks.
        suppressed = (prob != peak) & (prob > SUPPRESSED)
        rest = prob.masked_fill(suppressed, SUPPRESSED)
        seeds: list[torch.Tensor] = []
        for _ in range(count):
            seeds.append(rest.argmax(-1, keepdim=True))  # of equal values the first
            rest = rest.scatter(-1, seeds[-1], -1.0)
        return torch.cat(seeds, -1)


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
