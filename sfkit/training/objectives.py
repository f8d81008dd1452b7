"""What each architecture is trained with: sums over valid pixels, and the counts to divide them by.

An objective's terms come as sums and counts, never as means: so the loss of a batch is the same whether it
runs as one, in micro batches, or on several processes, which need only share the counts first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol, cast

import torch
import torch.nn.functional as F
from torch import nn


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
