"""The task vectors of a pool: all of it that merging computes with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch

from sfkit.merging.blocks import BlockPartition
from sfkit.merging.buffers import MAPPED_ABOVE, allocate
from sfkit.merging.flat import FlatLayout
from sfkit.merging.linear import merge_flat
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True, eq=False)
class TaskVectors:
    """Base and task vectors as flat buffers of one layout.

    Attributes:
        layout: where each changed tensor lies in the buffers.
        base: (P,) float32, the base's values.
        by_source: source name -> task vector (P,) float32; do not write to them.
        rounding: the narrower type whose values merges are rounded to; None where they are not.
    """

    layout: FlatLayout
    base: torch.Tensor
    by_source: Mapping[str, torch.Tensor]
    rounding: torch.dtype | None = None

    def merge_into(self, ordered: Recipe, out: torch.Tensor) -> torch.Tensor:
        """Write the merged parameters into ``out`` of shape (P,), and return it.

        Args:
            ordered: a recipe over these sources, which are added in its order.
            out: overwritten.
        """
        merge_flat(ordered, self.layout, self.base, [self.by_source[n] for n in ordered.sources], out)
        return self.rounded(out)

    def rounded(self, merged: torch.Tensor) -> torch.Tensor:
        """Round merged values (P,) in place, and return them."""
        return merged if self.rounding is None else merged.copy_(merged.to(self.rounding))

    def parted(self, partition: BlockPartition) -> TaskVectors:
        """The same values in the order of another block partition; shared where that is the same order."""
        layout = FlatLayout.of((spec for spec, _ in self.layout.entries), partition)
        moved = {name: self._moved(layout, vector) for name, vector in self.by_source.items()}
        return replace(self, layout=layout, base=self._moved(layout, self.base), by_source=moved)

    def _moved(self, layout: FlatLayout, flat: torch.Tensor) -> torch.Tensor:
        if layout.entries == self.layout.entries:
            return flat
        moved = allocate(layout.size, mapped=layout.size * 4 > MAPPED_ABOVE)
        layout.fill(moved, self.layout.views(flat))
        return moved
