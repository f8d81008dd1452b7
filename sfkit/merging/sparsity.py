"""Task vectors that are trimmed or dropped while they are read, piece by piece: none is ever held whole.

TIES (Yadav et al., NeurIPS 2023), step 1; DARE (Yu et al., ICML 2024).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import torch

from sfkit.checkpoints.checks import Kind
from sfkit.merging.flat import FlatLayout
from sfkit.merging.magnitudes import kth_magnitude
from sfkit.merging.steps import Drop, Sparse, Trim

PIECE = 1 << 16  # elements; pieces of 11 sources (2.9 MB) stay in the last cache; even, see _kept
COUNTED = 1 << 17  # elements at a time where one source is read alone
SUMMED = 1 << 15  # elements a partial sum: what is added to what decides the last bit, so this stays


@dataclass(frozen=True)
class Piece:
    """Elements ``start..stop`` of the flat buffers, part of one tensor, ``offset`` elements into it."""

    key: str
    kind: Kind
    offset: int
    start: int
    stop: int


@dataclass(frozen=True)
class Row:
    """One source's task vector on its way through the steps.

    Attributes:
        fingerprint: of its content.
        read: gives a piece of it as a float32 tensor, which the reader must not write to.
        write: writes a piece into a tensor of its size: for rows that would copy what they read.
    """

    fingerprint: str
    read: Callable[[Piece], torch.Tensor]
    write: Callable[[Piece, torch.Tensor], object] | None = None

    def copy(self, piece: Piece, out: torch.Tensor) -> None:
        """Write a piece into ``out``."""
        if self.write is not None:
            self.write(piece, out)
        else:
            out.copy_(self.read(piece))


class Thresholds:
    """Magnitudes to trim at, by what decides them: a grid over anything else finds them here."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, float, str], Mapping[str, float]] = {}

    def find(self, rows: Sequence[Row], step: Trim, layout: FlatLayout) -> None:
        """Find those of all rows, as many rows at a time as torch has threads."""
        with ThreadPoolExecutor(torch.get_num_threads()) as pool:
            list(pool.map(lambda row: self.get(row, step, layout), rows))

    def get(self, row: Row, step: Trim, layout: FlatLayout) -> Mapping[str, float]:
        """Key -> smallest magnitude that is kept in that tensor."""
        name = (row.fingerprint, step.density, step.per)
        if name not in self._known:
            self._known[name] = _thresholds(row, step, layout)
        return self._known[name]


def pieces(layout: FlatLayout, most: int = PIECE) -> tuple[tuple[Piece, ...], ...]:
    """The layout's tensors in order, each cut into pieces of at most ``most`` elements."""
    return tuple(
        tuple(
            Piece(spec.key, spec.kind, at, offset + at, offset + min(at + most, spec.size))
            for at in range(0, spec.size, most)
        )
        for spec, offset in layout.entries
    )


def thinned(row: Row, step: Sparse, layout: FlatLayout, identity: str, thresholds: Thresholds) -> Row:
    """The row after one step; running statistics pass as they are.

    Args:
        row: what comes in.
        step: what is done to it.
        layout: of the flat buffers.
        identity: the fingerprint of what comes out.
        thresholds: those known already.
    """
    if isinstance(step, Trim):
        return _trimmed(row, identity, thresholds.get(row, step, layout))
    return Row(identity, _dropped(row, step, layout))


def _trimmed(row: Row, identity: str, thresholds: Mapping[str, float]) -> Row:
    # hardshrink keeps what is larger than its lambda; the next smaller number makes that "at least as large".
    below = {key: _below(value) for key, value in thresholds.items()}

    def read(piece: Piece) -> torch.Tensor:
        values, least = row.read(piece), below.get(piece.key)
        return values if least is None else torch.hardshrink(values, least)

    def write(piece: Piece, out: torch.Tensor) -> None:
        least = below.get(piece.key)
        if least is None:
            row.copy(piece, out)
        else:
            torch.hardshrink(row.read(piece), least, out=out)

    return Row(identity, read, write)


def _below(value: float) -> float:
    return float(np.nextafter(np.float32(value), np.float32(0.0)))


def _thresholds(row: Row, step: Trim, layout: FlatLayout) -> dict[str, float]:
    """Smallest kept magnitude by key; a tensor without an entry keeps all: the source did not change it."""
    weights = [tensor for tensor in pieces(layout, COUNTED) if tensor and tensor[0].kind is Kind.WEIGHT]
    changed = [tensor for tensor in weights if any(_changed(row.read(piece)) for piece in tensor)]
    groups = [changed] if step.per == "vector" else [[tensor] for tensor in changed]
    found: dict[str, float] = {}
    for group in groups:
        count = sum(tensor[-1].stop - tensor[0].start for tensor in group)
        if not count:
            continue
        # However small the density, one entry is kept.
        value = kth_magnitude(partial(_read, row, group), count, max(1, int(step.density * count)))
        if value > 0.0:  # else fewer entries than that are not 0, and all of them stay
            found.update((tensor[0].key, value) for tensor in group)
    return found


def _changed(values: torch.Tensor) -> bool:
    """True where an entry is not 0: mostly one of the first is not."""
    return any(bool((part != 0).any()) for part in (values.numpy()[:64], values.numpy()[64:]))


def _read(row: Row, tensors: list[tuple[Piece, ...]]) -> Iterator[torch.Tensor]:
    return (row.read(piece) for tensor in tensors for piece in tensor)


def _dropped(row: Row, step: Drop, layout: FlatLayout) -> Callable[[Piece], torch.Tensor]:
    by_key = {tensor[0].key: tensor for tensor in pieces(layout, SUMMED) if tensor}

    def masked(piece: Piece) -> torch.Tensor:
        return row.read(piece) * _kept(row, step, piece)

    @lru_cache(maxsize=1)  # pieces of one tensor are read one after the other
    def factor(key: str) -> float:
        if step.rescale == "probability":
            return 1.0 / (1.0 - step.probability)
        if step.rescale == "none":
            return 1.0
        # Exact sums over pieces of one size: the same factor wherever it is computed.
        before = math.fsum(float(row.read(piece).abs().sum(dtype=torch.float64)) for piece in by_key[key])
        after = math.fsum(float(masked(piece).abs().sum(dtype=torch.float64)) for piece in by_key[key])
        return before / after if after > 0.0 else 1.0

    def read(piece: Piece) -> torch.Tensor:
        if piece.kind is Kind.STATISTIC:
            return row.read(piece)
        return masked(piece).mul_(factor(piece.key))

    return read


def _kept(row: Row, step: Drop, piece: Piece) -> torch.Tensor:
    """Which entries of a piece stay, (n,) bool: 32 bits each of PCG64, whose stream numpy keeps for good."""
    text = f"sfkit-drop/1 {step.seed} {row.fingerprint} {piece.key}"
    generator = np.random.PCG64(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))
    generator.advance(piece.offset // 2)  # one draw of 64 bits serves two entries
    size = piece.stop - piece.start
    # Little-endian on any machine, so that all keep the same entries.
    draws = np.asarray(generator.random_raw((size + 1) // 2)).astype("<u8").view("<u4")[:size]
    return torch.from_numpy(draws >= np.uint32(round(step.probability * 2**32)))
