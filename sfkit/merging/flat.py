"""The flat layout: every parameter that any source changed, in one buffer, grouped by (block, kind).

With the tensors of one block and kind side by side, a merge is one weighted sum a segment, whatever
the number of tensors.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import torch

from sfkit.checkpoints.checks import Kind, TensorSpec
from sfkit.merging.blocks import BlockPartition


@dataclass(frozen=True)
class Segment:
    """Elements ``start..stop`` of the buffer: one block's tensors of one kind."""

    block: int
    kind: Kind
    start: int
    stop: int


@dataclass(frozen=True)
class FlatLayout:
    """Where each tensor lies in a flat buffer of ``size`` float32 elements.

    Attributes:
        entries: the tensors in buffer order with their first element's offset.
        segments: the (block, kind) groups, covering the buffer without gaps.
        size: P, the number of elements.
    """

    entries: tuple[tuple[TensorSpec, int], ...]
    segments: tuple[Segment, ...]
    size: int

    @classmethod
    def of(cls, specs: Iterable[TensorSpec], partition: BlockPartition) -> FlatLayout:
        """Lay tensors out by block (outside first), kind and key; constants have no place."""
        ranked = sorted(
            (spec for spec in specs if spec.kind is not Kind.CONSTANT),
            # By key, not by the module's order: packed vectors in the cache must not depend on how a network
            # is written.
            key=lambda spec: (partition.block_of(spec.key), spec.kind is Kind.STATISTIC, spec.key),
        )
        entries: list[tuple[TensorSpec, int]] = []
        segments: list[Segment] = []
        offset = 0
        for spec in ranked:
            block = partition.block_of(spec.key)
            entries.append((spec, offset))
            last = segments[-1] if segments else None
            start = last.start if last and (last.block, last.kind) == (block, spec.kind) else offset
            # The segment goes on: it is put back longer.
            if last and start == last.start:
                segments.pop()
            offset += spec.size
            segments.append(Segment(block, spec.kind, start, offset))
        return cls(tuple(entries), tuple(segments), offset)

    def views(self, flat: torch.Tensor) -> dict[str, torch.Tensor]:
        """Key -> view into ``flat`` of shape (P,), with the tensor's own shape; aliases included."""
        named: dict[str, torch.Tensor] = {}
        for spec, offset in self.entries:
            view = flat[offset : offset + spec.size].view(spec.shape)
            named.update(dict.fromkeys((spec.key, *spec.aliases), view))
        return named

    def fill(self, flat: torch.Tensor, tensors: Mapping[str, torch.Tensor]) -> None:
        """Copy tensors into ``flat`` (P,) by key; a tensor that is absent leaves its place as it was."""
        for spec, offset in self.entries:
            # A file may hold a tied tensor under any of its keys.
            name = next((k for k in (spec.key, *spec.aliases) if k in tensors), None)
            if name is not None:
                flat[offset : offset + spec.size].copy_(tensors[name].reshape(-1))
