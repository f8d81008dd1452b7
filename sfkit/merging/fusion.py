"""One task vector made of several, entry by entry and piece by piece.

TIES (Yadav et al., NeurIPS 2023), steps 2 and 3; Fisher-weighted averaging (Matena and Raffel, NeurIPS
2022). Sources come in the order of their fingerprints, so that no other order changes a bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch

from sfkit.checkpoints.checks import Kind
from sfkit.merging.flat import FlatLayout
from sfkit.merging.sparsity import PIECE, Piece, Row, pieces
from sfkit.merging.steps import Elect, FisherMean, Fused

Importances = Mapping[str, torch.Tensor]
"""Source name -> Fisher information (P,) in the pool's flat layout."""


def fuse(
    step: Fused,
    rows: Sequence[Row],
    layout: FlatLayout,
    out: torch.Tensor,
    *,
    weights: Sequence[float] = (),
    importances: Sequence[torch.Tensor] = (),
) -> None:
    """Write the one vector a step makes of ``rows`` into ``out`` (P,); running statistics become their mean.

    Args:
        step: what is done.
        rows: E task vectors.
        layout: of the flat buffers.
        out: overwritten.
        weights: of :class:`Elect`, in the order of the rows; none weighs all equally.
        importances: of :class:`FisherMean`, in the order of the rows.
    """
    # A cache line more than a power of two: rows that far apart would fall on the same places of the cache.
    scratch = torch.empty(len(rows), PIECE + 16, dtype=torch.float32)
    election = _Election(step, weights, len(rows)) if isinstance(step, Elect) else None
    for tensor in pieces(layout):
        for piece in tensor:
            stack = _gather(rows, piece, scratch)
            target = out[piece.start : piece.stop]
            if piece.kind is Kind.STATISTIC or not isinstance(step, Elect | FisherMean):
                torch.mean(stack, dim=0, out=target)
            elif election is not None:
                election.write(stack, target, piece)
            elif isinstance(step, FisherMean):
                _fisher(stack, [f[piece.start : piece.stop] for f in importances], step.floor, target)
    if election is not None:
        election.settle(lambda piece: _gather(rows, piece, scratch), out)


def _gather(rows: Sequence[Row], piece: Piece, scratch: torch.Tensor) -> torch.Tensor:
    stack = scratch[:, : piece.stop - piece.start]
    for e, row in enumerate(rows):
        row.copy(piece, stack[e])
    return stack


def _fisher(stack: torch.Tensor, information: list[torch.Tensor], floor: float, out: torch.Tensor) -> None:
    """Sum F_i tau_i / sum F_i, which is (sum F_i theta_i / sum F_i) - theta_0."""
    # Without a floor an entry that no source's loss feels would be 0 / 0.
    weights = torch.stack(information).clamp_(min=floor)
    torch.div((weights * stack).sum(dim=0), weights.sum(dim=0), out=out)


class _Election:
    """Signs by the sum of the entries; a sum of 0 waits for the majority of the whole vector.

    Comparisons are numpy's, on the same memory: torch takes 10 times as long for them.
    """

    def __init__(self, step: Elect, weights: Sequence[float], rows: int) -> None:
        self.step = step
        self.weights = torch.tensor(weights, dtype=torch.float32)[:, None] if weights else None
        # No sum of voices is smaller, unless nobody has one; tiny where float32 cannot tell a weight from 0.
        least = 1.0 if self.weights is None else float(self.weights.min())
        self.least = max(least, torch.finfo(torch.float32).tiny)
        self.balance = 0.0  # entries that elect plus, less those that elect minus
        self.undecided: list[Piece] = []
        self._signs, self._voices = torch.empty(2, PIECE, dtype=torch.float32)
        self._flags = np.empty((rows, PIECE), np.bool_)
        self._whole = np.uint8 if rows < 256 else np.uint32  # holds any count of rows

    def write(self, stack: torch.Tensor, out: torch.Tensor, piece: Piece) -> None:
        signs, zero = self._elect(stack)
        if self.step.zero == "plus":
            self._combine(stack, signs, zero, 1.0, out)
            return
        self.balance += float(signs.sum())  # exact: whole numbers, and a piece has far less than 2**24
        self._combine(stack, signs, zero, 1.0, out)
        # Where a sum of 0 elects plus, those that are not 0 show: entries that sum to 0 are not all negative.
        elected = out.numpy()
        if bool(((elected != 0) & zero).any()):
            self.undecided.append(piece)
            elected[zero] = 0.0

    def settle(self, gather: Callable[[Piece], torch.Tensor], out: torch.Tensor) -> None:
        """Give the sums of 0 the sign most entries have; where as many have either, they stay 0."""
        majority = float((self.balance > 0) - (self.balance < 0))
        for piece in self.undecided if majority else ():
            stack = gather(piece)
            self._combine(stack, *self._elect(stack), majority, out[piece.start : piece.stop])

    def _elect(self, stack: torch.Tensor) -> tuple[torch.Tensor, np.ndarray]:
        """Signs of the sums, and where these are 0."""
        if self.weights is not None:
            stack.mul_(self.weights)
        signs = torch.sum(stack, dim=0, out=self._signs[: stack.shape[1]]).sign_()
        return signs, signs.numpy() == 0

    def _combine(
        self, stack: torch.Tensor, signs: torch.Tensor, zero: np.ndarray, sign: float, out: torch.Tensor
    ) -> None:
        """What agrees with ``signs``, with ``sign`` in the places of ``zero``; overwrites its arguments."""
        np.copyto(signs.numpy(), np.float32(sign), where=zero)
        agreeing = stack.mul_(signs).clamp_(min=0.0)  # magnitudes of those that agree, 0 for the others
        torch.sum(agreeing, dim=0, out=out)
        if self.step.combine == "mean":
            out.div_(self._counted(agreeing).clamp_(min=self.least))  # 0 / least where there is none
        out.mul_(signs)

    def _counted(self, agreeing: torch.Tensor) -> torch.Tensor:
        """How many entries agree, or their weight; overwrites its argument."""
        voices: torch.Tensor = self._voices[: agreeing.shape[1]]
        if self.weights is not None:
            return torch.sum(agreeing.sign_().mul_(self.weights), dim=0, out=voices)
        flags = np.greater(agreeing.numpy(), 0.0, out=self._flags[:, : agreeing.shape[1]])
        np.copyto(voices.numpy(), np.add.reduce(flags.view(np.uint8), axis=0, dtype=self._whole))
        return voices
