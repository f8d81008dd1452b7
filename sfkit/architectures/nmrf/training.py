"""How NMRF's parameters are optimised: which learn slowly, which do not decay."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

from torch import nn

from sfkit.architectures.nmrf.network import NMRF

# One-cycle schedules with these peaks; gradients are clipped to a norm of 1.
LEARNING_RATE = 5e-4
FINE_TUNING_RATE = 2e-4
CLIP_NORM = 1.0
WEIGHT_DECAY = 1e-5
SLOWDOWN = 0.1
SLOW = ("image_encoder.backbone.*", "*.sampling_offsets.*")
WITHOUT_DECAY = ("*.relative_position_*_table",)


def parameter_groups(
    network: NMRF, rate: float = FINE_TUNING_RATE, weight_decay: float = WEIGHT_DECAY
) -> list[dict[str, Any]]:
    """Parameter groups for ``torch.optim.AdamW``, each parameter in exactly one.

    Swin-T and the sampling offsets learn at a tenth of ``rate``, the residual encoder at full rate;
    relative-position tables do not decay.
    """
    groups: dict[tuple[float, float], list[nn.Parameter]] = {}
    for name, parameter in network.named_parameters():
        slow, tables = (any(fnmatchcase(name, p) for p in patterns) for patterns in (SLOW, WITHOUT_DECAY))
        setting = (rate * SLOWDOWN if slow else rate, 0.0 if tables else weight_decay)
        groups.setdefault(setting, []).append(parameter)
    return [{"params": p, "lr": lr, "weight_decay": decay} for (lr, decay), p in groups.items()]
