"""A network that takes its time and no processor: what a search does beside forward passes weighs more."""

from __future__ import annotations

import time

import torch
from torch import nn

from sfkit.architectures import register_architecture

SECONDS = 0.003


@register_architecture("brief", blocks={"level": ["level"], "slope": ["slope"]}, version="1")
class Brief(nn.Module):
    """Disparity = level + slope * brightness, in pixels, after 3 ms of sleep."""

    def __init__(self) -> None:
        super().__init__()
        self.level = nn.Parameter(torch.zeros(1))
        self.slope = nn.Parameter(torch.zeros(1))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        time.sleep(SECONDS)
        return self.level + self.slope * left.mean(1)
