"""What each architecture is trained with: sums over valid pixels, and the counts to divide them by.

An objective's terms come as sums and counts, never as means: so the loss of a batch is the same whether it
runs as one, in micro batches, or on several processes, which need only share the counts first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf import training as nmrf
from sfkit.architectures.nmrf.network import NMRF
from sfkit.errors import InputError

Groups = list[dict[str, Any]]


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


ANYNET_WEIGHTS = (0.25, 0.5, 1.0, 1.0)
"""Of AnyNet's stages, coarse to fine (Wang et al., ICRA 2019, section IV)."""


def _stages(network: nn.Module, left: torch.Tensor, right: torch.Tensor) -> Iterable[torch.Tensor]:
    return cast(Iterable[torch.Tensor], cast(Any, network).stages(left, right))


def _output(network: nn.Module, left: torch.Tensor, right: torch.Tensor) -> Iterable[torch.Tensor]:
    return (network(left, right),)


@dataclass(frozen=True)
class Recipe:
    """How an architecture is fine-tuned where the settings leave it open.

    Attributes:
        objective: the loss.
        rate: peak learning rate.
        limit: truth of so many pixels and more does not count.
        groups: network, rate, decay -> parameter groups, each with its own peak.
    """

    objective: Objective
    rate: float
    limit: float
    groups: Callable[[nn.Module, float, float], Groups]


def _one_group(network: nn.Module, rate: float, decay: float) -> Groups:
    return [
        {"params": [p for p in network.parameters() if p.requires_grad], "lr": rate, "weight_decay": decay}
    ]


def _nmrf_groups(network: nn.Module, rate: float, decay: float) -> Groups:
    return nmrf.parameter_groups(cast(NMRF, network), rate, decay)


ANYNET = Recipe(SequenceObjective(_stages, lambda n: ANYNET_WEIGHTS[:n]), 5e-4, 192.0, _one_group)
OUTPUT = Recipe(SequenceObjective(_output, lambda n: (1.0,) * n), 1e-4, 192.0, _one_group)
RECIPES: Mapping[str, Recipe] = {"anynet": ANYNET, "anynet-slim": ANYNET, "anynet-wide": ANYNET}
"""By the registry's names; any other network learns by smooth L1 on its output, or by its own ``loss``."""


def recipe_of(architecture: str, network: nn.Module) -> Recipe:
    """How a network of ``architecture`` is fine-tuned.

    Raises:
        InputError: the network has a ``loss`` that cannot be called.
    """
    if architecture in RECIPES:
        return RECIPES[architecture]
    own = getattr(network, "loss", None)
    if own is None:
        return OUTPUT
    if not callable(own):
        raise InputError(
            f"architecture {architecture!r}: its loss is {own!r}, expected loss(left, right, truth)"
        )
    return Recipe(OwnObjective(), OUTPUT.rate, OUTPUT.limit, _one_group)
