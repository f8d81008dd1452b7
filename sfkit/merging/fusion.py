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
    scratch = torch.empty(len(rows), PIECE, dtype=torch.float32)
    election = _Election(step, weights) if isinstance(step, Elect) else None
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
        stack[e].copy_(row.read(piece))
    return stack


def _fisher(stack: torch.Tensor, information: list[torch.Tensor], floor: float, out: torch.Tensor) -> None:
    """Sum F_i tau_i / sum F_i, which is (sum F_i theta_i / sum F_i) - theta_0."""
    weights = torch.stack(information).clamp_(min=floor)
    torch.div((weights * stack).sum(dim=0), weights.sum(dim=0), out=out)


class _Election:
    """Signs by the sum of the entries; a sum of 0 waits for the majority of the whole vector.

    Comparisons are numpy's, on the same memory: torch takes 10 times as long for them.
    """

    def __init__(self, step: Elect, weights: Sequence[float]) -> None:
        self.step = step
        self.weights = torch.tensor(weights, dtype=torch.float32)[:, None] if weights else None
        # No sum of voices is smaller, unless nobody has one; tiny where float32 cannot tell a weight from 0.
        least = 1.0 if self.weights is None else float(self.weights.min())
        self.least = max(least, torch.finfo(torch.float32).tiny)
        self.balance = 0.0  # entries that elect plus, less those that elect minus
        self.undecided: list[Piece] = []

    def write(self, stack: torch.Tensor, out: torch.Tensor, piece: Piece) -> None:
        signs = self._signs(stack)
        if self.step.zero == "plus":
            _fill_zeros(signs, 1.0)
        else:
            self.balance += float(signs.sum(dtype=torch.float64))
            if self._cancels(stack, signs):
                self.undecided.append(piece)
        self._combine(stack, signs, out)

    def settle(self, gather: Callable[[Piece], torch.Tensor], out: torch.Tensor) -> None:
        """Give the sums of 0 the sign most entries have; where as many have either, they stay 0."""
        majority = float((self.balance > 0) - (self.balance < 0))
        for piece in self.undecided if majority else ():
            stack = gather(piece)
            signs = self._signs(stack)
            _fill_zeros(signs, majority)
            self._combine(stack, signs, out[piece.start : piece.stop])

    def _signs(self, stack: torch.Tensor) -> torch.Tensor:
        if self.weights is not None:
            stack.mul_(self.weights)
        return stack.sum(dim=0).sign_()

    @staticmethod
    def _cancels(stack: torch.Tensor, signs: torch.Tensor) -> bool:
        """True where entries that are not 0 sum to 0: with all at 0 the sign does not matter."""
        empty = signs.numpy() == 0
        if not empty.any():
            return False
        bits = np.bitwise_or.reduce(stack.numpy().view(np.uint32), axis=0)
        return bool(((bits << 1 != 0) & empty).any())  # the bit shifted out is the sign: -0 is 0

    def _combine(self, stack: torch.Tensor, signs: torch.Tensor, out: torch.Tensor) -> None:
        agreeing = stack.mul_(signs).clamp_(min=0.0)  # magnitudes of those that agree, 0 for the others
        torch.sum(agreeing, dim=0, out=out)
        if self.step.combine == "mean":
            voices = agreeing.sign_() if self.weights is None else agreeing.sign_().mul_(self.weights)
            out.div_(voices.sum(dim=0).clamp_(min=self.least))  # 0 / least where there is none
        out.mul_(signs)


def _fill_zeros(signs: torch.Tensor, sign: float) -> None:
    values = signs.numpy()
    np.copyto(values, np.float32(sign), where=values == 0)
