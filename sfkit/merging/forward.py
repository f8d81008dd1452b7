"""How a forward pass computes: its numeric precision and memory layout, which belong to evaluation keys."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sfkit.errors import ensure_known

if TYPE_CHECKING:
    import torch

PRECISIONS = ("float32", "bfloat16")


@dataclass(frozen=True)
class ForwardMode:
    """How networks run.

    Attributes:
        precision: ``"float32"``, or ``"bfloat16"`` for autocast: weights, merges and disparities stay
            float32, convolutions and products are computed in bfloat16.
        channels_last: whether images enter with their channels innermost, which some convolutions are
            faster on. Weights stay as they lie in the flat buffer.

    Raises:
        InputError: an unknown precision.
    """

    precision: str = "float32"
    channels_last: bool = False

    def __post_init__(self) -> None:
        ensure_known("precision", self.precision, PRECISIONS)

    def describe(self) -> dict[str, Any]:
        """What of this an evaluation's key holds; the layout only where it is not the usual one."""
        return {"precision": self.precision} | ({"channels_last": True} if self.channels_last else {})

    def computing(self, device: torch.device) -> AbstractContextManager[Any]:
        """The context a forward pass runs in on ``device``."""
        if self.precision == "float32":
            return nullcontext()
        import torch

        return torch.autocast(device.type, dtype=torch.bfloat16)

    def place(self, images: torch.Tensor, device: torch.device) -> torch.Tensor:
        """Images (N, 3, H, W) on ``device`` in this mode's memory layout."""
        if not self.channels_last:
            return images.to(device)
        import torch

        return images.to(device, memory_format=torch.channels_last)
