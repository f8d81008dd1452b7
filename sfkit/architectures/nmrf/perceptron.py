"""The two small perceptrons every part of NMRF uses: a feed-forward block and a three-layer head."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn


class FeedForward(nn.Module):
    """Linear, exact GELU, linear; (..., c_in) -> (..., c_out)."""

    def __init__(self, c_in: int, hidden: int, c_out: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(c_in, hidden)
        self.fc2 = nn.Linear(hidden, c_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., c_in) -> (..., c_out)."""
        y: torch.Tensor = self.fc2(F.gelu(self.fc1(x)))
        return y


class Head(nn.Module):
    """Three linear layers with ReLU between them; (..., width) -> (..., c_out)."""

    def __init__(self, width: int, c_out: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(width, out) for out in (width, width, c_out))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., width) -> (..., c_out)."""
        first, second, last = self.layers
        y: torch.Tensor = last(F.relu(second(F.relu(first(x)))))
        return y
