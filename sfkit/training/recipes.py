"""How each architecture is fine-tuned where the settings leave it open."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import nn

from sfkit.architectures import AnyNet, FoundationStereo
from sfkit.architectures.nmrf import training as nmrf
from sfkit.architectures.nmrf.network import NMRF
from sfkit.errors import InputError
from sfkit.training.objectives import (
    FoundationStereoObjective,
    NmrfObjective,
    Objective,
    OwnObjective,
    SequenceObjective,
)

Groups = list[dict[str, Any]]
ANYNET_WEIGHTS = (0.25, 0.5, 1.0, 1.0)
"""Of AnyNet's stages, coarse to fine (Wang et al., ICRA 2019, section IV)."""


@dataclass(frozen=True)
class TrainingRecipe:
    """One architecture's.

    Attributes:
        objective: the loss.
        rate: peak learning rate.
        limit: truth of so many pixels and more does not count; the objective may have further limits.
        groups: network, rate, decay -> parameter groups, each with its own peak.
        steady: whether every pass is known to use the same parameters.
    """

    objective: Objective
    rate: float
    limit: float
    groups: Callable[[nn.Module, float, float], Groups]
    steady: bool = False


def training_recipe(network: nn.Module, limit: float | None = None) -> TrainingRecipe:
    """How a network is fine-tuned: the embedded ones as their authors do, with smooth L1 as the distance.

    Any other learns by its own ``loss(left, right, truth)``, the mean over the known pixels of a batch, or
    where it has none by smooth L1 on its output.

    Args:
        network: what :meth:`Architecture.build` made.
        limit: in pixels, in the place of the architecture's own.

    Raises:
        InputError: the network has a ``loss`` that cannot be called.
    """
    if isinstance(network, AnyNet):
        objective: Objective = SequenceObjective(_stages, lambda n: ANYNET_WEIGHTS[:n])
        return TrainingRecipe(objective, 5e-4, limit or 192.0, one_group, steady=True)
    if isinstance(network, NMRF):
        objective = NmrfObjective(network.dpn.bins, limit or nmrf.TRAINING_LIMIT)
        return TrainingRecipe(objective, nmrf.FINE_TUNING_RATE, math.inf, _nmrf_groups, steady=True)
    if isinstance(network, FoundationStereo):
        return TrainingRecipe(FoundationStereoObjective(), 1e-5, limit or 416.0, one_group, steady=True)
    own = getattr(network, "loss", None)
    if own is not None and not callable(own):
        raise InputError(f"{type(network).__name__}: its loss is {own!r}, expected loss(left, right, truth)")
    objective = SequenceObjective(_output, lambda n: (1.0,) * n) if own is None else OwnObjective()
    return TrainingRecipe(objective, 1e-4, limit or 192.0, one_group)


def one_group(network: nn.Module, rate: float, decay: float) -> Groups:
    """All trainable parameters alike."""
    parameters = [p for p in network.parameters() if p.requires_grad]
    return [{"params": parameters, "lr": rate, "weight_decay": decay}]


def _nmrf_groups(network: nn.Module, rate: float, decay: float) -> Groups:
    return nmrf.parameter_groups(cast(NMRF, network), rate, decay)


def _stages(network: nn.Module, left: torch.Tensor, right: torch.Tensor) -> Iterable[torch.Tensor]:
    return cast(Iterable[torch.Tensor], cast(Any, network).stages(left, right))


def _output(network: nn.Module, left: torch.Tensor, right: torch.Tensor) -> Iterable[torch.Tensor]:
    return (network(left, right),)
