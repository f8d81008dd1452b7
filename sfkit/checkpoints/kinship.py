"""How near a source lies to its base: what tells a fine-tune from another network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import torch


@dataclass(frozen=True)
class Kinship:
    """How near a source lies to its base, over matrices and kernels (tensors of 2 dimensions or more).

    Attributes:
        cosine: of the source's weights to the base's; a fine-tune stays near 1.
        distance: norm of the task vector divided by the norm of the base's weights.
    """

    cosine: float
    distance: float

    MIN_COSINE = 0.5
    MAX_DISTANCE = 1.0

    @property
    def is_fine_tune(self) -> bool:
        """False where direction or size says that the source did not start from this base."""
        return self.cosine >= self.MIN_COSINE and self.distance <= self.MAX_DISTANCE


@dataclass
class KinshipSums:
    """Running sums from which :class:`Kinship` follows, fed tensor by tensor in float64."""

    base: float = 0.0
    source: float = 0.0
    dot: float = 0.0

    def add(self, base: torch.Tensor, source: torch.Tensor) -> None:
        """Take one pair of tensors in; vectors and scalars are left out, for norm layers all look alike."""
        if base.ndim >= 2:
            # In float64: a fine-tune's distance is a small difference of these sums.
            b, s = base.reshape(-1).double(), source.reshape(-1).double()
            self.base += float(b @ b)
            self.source += float(s @ s)
            self.dot += float(b @ s)

    def add_arrays(self, base: np.ndarray, source: np.ndarray) -> None:
        """The same of arrays."""
        if base.ndim >= 2:
            b, s = base.reshape(-1).astype(float), source.reshape(-1).astype(float)
            self.base += float(b @ b)
            self.source += float(s @ s)
            self.dot += float(b @ s)

    def kinship(self) -> Kinship:
        """The finished figures; without any matrix the source counts as near."""
        if self.base == 0.0 or self.source == 0.0:
            return Kinship(1.0, 0.0)
        # Rounding can carry the square of a tiny distance below 0.
        squared = max(self.base + self.source - 2 * self.dot, 0.0)
        return Kinship(self.dot / (self.base * self.source) ** 0.5, (squared / self.base) ** 0.5)
