"""Task-vector geometry: how far each source went, block by block, and whose ways agree.

Only parameters count (kind = weight): running statistics follow the data, not the learning, and their
size would drown the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from sfkit.checkpoints.checks import Kind
from sfkit.errors import InputError
from sfkit.merging.blocks import OUTSIDE
from sfkit.merging.pool import Pool

Matrix = NDArray[np.float64]

CHUNK = 1 << 18
"""Elements of every task vector that are looked at together; 11 of them are 11 MiB in float32."""

OUTSIDE_NAME = "(outside)"


@dataclass(frozen=True, eq=False)
class TaskVectorGeometry:
    """Numbers of E task vectors over B blocks (outside parameters are one more, where there are any).

    Attributes:
        sources: E names.
        blocks: B names.
        sizes: (B,) parameters in each block that any source changed.
        norms: (B, E) Euclidean norm of each source's task vector in each block.
        base_norms: (B,) norm of the base's parameters there.
        products: (B, E, E) inner products of task vectors in each block.
        shared: (B,) parameters that two sources or more moved.
        conflicts: (B,) share of these in which the sources' signs differ.
        pair_conflicts: (E, E) share of the parameters that both sources moved, in which their signs differ.
    """

    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    sizes: NDArray[np.int64]
    norms: Matrix
    base_norms: Matrix
    products: Matrix
    shared: NDArray[np.int64]
    conflicts: Matrix
    pair_conflicts: Matrix

    @property
    def conflict(self) -> float:
        """Share of all parameters that two sources or more moved in which their signs differ."""
        total = int(self.shared.sum())
        return float(self.conflicts @ self.shared) / total if total else 0.0

    @property
    def cosines(self) -> Matrix:
        """(E, E) cosine between whole task vectors; NaN for a source that moved nothing."""
        return _cosines(self.products.sum(axis=0))

    @property
    def relative(self) -> Matrix:
        """(B, E) norm of the task vector in percent of the base's norm in the block."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(100.0 * self.norms / self.base_norms[:, None])

    def table(self) -> pd.DataFrame:
        """A row a block: size, share of sign conflicts, each source's norm in percent of the base's."""
        table = pd.DataFrame(
            self.relative, index=pd.Index(self.blocks, name="block"), columns=[*self.sources]
        )
        table.insert(0, "sign conflicts [%]", 100.0 * self.conflicts)
        table.insert(0, "parameters", self.sizes)
        return table


def task_vector_geometry(pool: Pool) -> TaskVectorGeometry:
    """Measure the pool's task vectors, a chunk of all of them at a time; sums are in float64.

    Raises:
        InputError: the pool has no source, or none changed a parameter.
    """
    names = pool.names
    blocks: dict[int, str] = {}
    for segment in pool.layout.segments:
        if segment.kind is Kind.WEIGHT:
            name = OUTSIDE_NAME if segment.block == OUTSIDE else pool.blocks[segment.block]
            blocks.setdefault(segment.block, name)
    if not names or not blocks:
        raise InputError(f"pool {pool.name!r}: found no task vector, expected sources that changed something")
    # The partition's order, what no block holds last.
    order = sorted(blocks, key=lambda block: (block == OUTSIDE, block))
    made = [_block(pool, block) for block in order]
    moved_by_both = np.sum([part.moved for part in made], axis=0)
    opposed = np.sum([part.opposed for part in made], axis=0)
    # Where no two sources moved the same parameters there is nothing to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = [part.conflicting / part.shared if part.shared else 0.0 for part in made]
        pairs = np.where(moved_by_both > 0, opposed / moved_by_both, 0.0)
    products = np.stack([part.products for part in made])
    return TaskVectorGeometry(
        sources=names,
        blocks=tuple(blocks[block] for block in order),
        sizes=np.array([part.size for part in made]),
        # A vector's product with itself is its squared norm.
        norms=np.sqrt(np.diagonal(products, axis1=1, axis2=2)),
        base_norms=np.sqrt([part.base for part in made]),
        products=products,
        shared=np.array([part.shared for part in made]),
        conflicts=np.array(shares),
        pair_conflicts=pairs,
    )


@dataclass
class _Sums:
    products: Matrix
    moved: Matrix
    opposed: Matrix
    size: int = 0
    base: float = 0.0
    shared: int = 0
    conflicting: int = 0


def _block(pool: Pool, block: int) -> _Sums:
    square = (len(pool.names), len(pool.names))
    sums = _Sums(np.zeros(square), np.zeros(square), np.zeros(square))
    for base, chunk in _chunks(pool, block):
        # Products of signs count: 1 where two sources agree, -1 where they differ, 0 where one stood still.
        signs = torch.sign(chunk)
        moved = signs.abs()
        sums.products += (chunk @ chunk.T).numpy()
        both, agreeing = (moved @ moved.T).numpy(), (signs @ signs.T).numpy()
        sums.moved += both
        sums.opposed += (both - agreeing) / 2  # agreements minus conflicts, of their sum
        count = moved.sum(dim=0)
        # Signs that agree add up to their number; any conflict leaves less.
        differ = signs.sum(dim=0).abs() < count
        sums.size += chunk.shape[1]
        sums.base += float(base @ base)
        sums.shared += int((count >= 2).sum())
        sums.conflicting += int(differ.sum())
    return sums


def _chunks(pool: Pool, block: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """The base's values (n,) and all task vectors (E, n) in one block, piece by piece, in float64."""
    for segment in pool.layout.segments:
        if segment.block != block or segment.kind is not Kind.WEIGHT:
            continue
        # A piece of all vectors at a time: those of large pools lie in mapped files.
        for start in range(segment.start, segment.stop, CHUNK):
            part = slice(start, min(start + CHUNK, segment.stop))
            stacked = torch.stack([pool.vectors[name][part] for name in pool.names])
            yield pool.base_flat[part].double(), stacked.double()


def _cosines(products: Matrix) -> Matrix:
    lengths = np.sqrt(np.diagonal(products))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Rounding can carry a cosine beyond 1.
        return np.asarray(np.clip(products / np.outer(lengths, lengths), -1.0, 1.0))
