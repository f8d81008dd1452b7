"""What each architecture is trained with: sums over valid pixels, and the counts to divide them by.

An objective's terms come as sums and counts, never as means: so the loss of a batch is the same whether it
runs as one, in micro batches, or on several processes, which need only share the counts first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.foundation_stereo.network import FoundationStereo
from sfkit.architectures.nmrf.network import NMRF
from sfkit.architectures.nmrf.proposals import STRIDE
from sfkit.architectures.nmrf.training import LossWeights, losses, target_histogram


class Objective(Protocol):
    """Terms of a loss, K of them. ``truth`` is (B, H, W) px, NaN where nothing is known or counts."""

    def counts(self, truth: torch.Tensor) -> torch.Tensor:
        """What each term's sum is divided by, (K,); depends on the truth alone."""
        ...

    def sums(
        self, network: nn.Module, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor
    ) -> torch.Tensor:
        """Each weighted term summed over its pixels, (K,), attached to the network even where none is
        valid.
        """
        ...


def _smooth(disparity: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Sum over known pixels of smooth L1 (beta 1) between two maps (B, H, W)."""
    known = torch.isfinite(truth)
    # 0 for what is not known: NaN times 0 is NaN, in the gradient as well.
    distance = F.smooth_l1_loss(disparity.float(), torch.where(known, truth, 0.0), reduction="none")
    return (distance * known).sum()


def _known(truth: torch.Tensor) -> torch.Tensor:
    return torch.isfinite(truth).sum().to(torch.float64)


@dataclass(frozen=True)
class SequenceObjective:
    """Smooth L1 of several full-size maps, weighted; ``maps`` runs the network and returns them in order."""

    maps: Callable[[nn.Module, torch.Tensor, torch.Tensor], Iterable[torch.Tensor]]
    weights: Callable[[int], Iterable[float]]

    def counts(self, truth: torch.Tensor) -> torch.Tensor:
        """The number of known pixels."""
        return _known(truth)[None]

    def sums(
        self, network: nn.Module, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor
    ) -> torch.Tensor:
        """One term: all maps, weighted."""
        maps = list(self.maps(network, left, right))
        terms = [w * _smooth(m, truth) for w, m in zip(self.weights(len(maps)), maps, strict=True)]
        return torch.stack(terms).sum()[None]


@dataclass(frozen=True)
class OwnObjective:
    """The network's own ``loss(left, right, truth)``: a scalar mean over the known pixels of a batch."""

    def counts(self, truth: torch.Tensor) -> torch.Tensor:
        """The number of known pixels."""
        return _known(truth)[None]

    def sums(
        self, network: nn.Module, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor
    ) -> torch.Tensor:
        """The mean times the number of known pixels."""
        loss = cast(Any, network).loss(left, right, truth)
        return cast(torch.Tensor, loss * _known(truth).to(loss.dtype))[None]


GAMMA = 0.9
QUARTER = 4


@dataclass(frozen=True)
class NmrfObjective:
    """NMRF's own terms, with smooth L1 as the layers' distance (Guan et al., CVPR 2024, section 3.5).

    Bins and proposals learn from truth below ``bins`` times 8 px, the layers from truth below ``limit``.
    """

    bins: int
    limit: float
    weights: LossWeights = field(default_factory=LossWeights)

    def counts(self, truth: torch.Tensor) -> torch.Tensor:
        """Blocks with any truth in the bins, pixels of the proposals' term, pixels of the layers' terms."""
        known = torch.where(torch.isfinite(truth), truth, 0.0)
        blocks = target_histogram(known, self.bins).flatten(0, 1).sum(-1) > 0
        layers = (known > 0) & (known < self.limit)
        proposals = layers & (known < self.bins * STRIDE)
        return torch.stack([part.sum() for part in (blocks, proposals, layers)]).double()

    def sums(
        self, network: nn.Module, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor
    ) -> torch.Tensor:
        """The three terms' means times their counts."""
        found = losses(cast(NMRF, network).estimate(left, right), truth, max_disp=self.limit, smooth=True)
        weights = self.weights
        layers = zip((*weights.coarse, *weights.refined), (*found.coarse, *found.refined), strict=True)
        means = [
            weights.init * found.init,
            weights.proposal * found.proposal,
            torch.stack([weight * loss for weight, loss in layers]).sum(),
        ]
        # Means become sums again, which the loop divides by what the whole step counts.
        return torch.stack(means) * self.counts(truth).to(found.init.dtype)


@dataclass(frozen=True)
class FoundationStereoObjective:
    """Smooth L1 of the first disparity, plus that of every refined one, the later the heavier.

    Wen et al., "FoundationStereo" (CVPR 2025): gamma^(K - k) for refinement k of K. The first
    disparity lives at a quarter of the size, so the truth is read there at every fourth row and column. The
    paper takes L1 for the refined ones; smooth L1 is the merging paper's for all networks.
    """

    def counts(self, truth: torch.Tensor) -> torch.Tensor:
        """Known pixels of the quarter, and of the whole."""
        return torch.stack([torch.isfinite(t).sum() for t in (_quarter(truth), truth)]).double()

    def sums(
        self, network: nn.Module, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor
    ) -> torch.Tensor:
        """The two terms."""
        trace = cast(FoundationStereo, network).trace(left, right)
        count = len(trace.disparities)
        refined = [
            GAMMA ** (count - number) * _smooth(map_, truth)
            for number, map_ in enumerate(trace.disparities, start=1)
        ]
        return torch.stack([_smooth(trace.initial[:, 0], _quarter(truth)), torch.stack(refined).sum()])


def _quarter(truth: torch.Tensor) -> torch.Tensor:
    """(B, H, W) px -> (B, H/4, W/4) in pixels of the quarter; nothing is averaged across edges or unknown."""
    # Read, not averaged: the mean of a near and a far pixel is a depth that neither has.
    return truth[..., ::QUARTER, ::QUARTER] / QUARTER
