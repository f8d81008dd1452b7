"""One task vector made of several, entry by entry and piece by piece.

TIES (Yadav et al., NeurIPS 2023), steps 2 and 3; Fisher-weighted averaging (Matena and Raffel, NeurIPS
2022). Sources come in the order of their fingerprints, so that no other order changes a bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

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
    """Signs by the sum of the entries; a sum of 0 waits for the majority of the whole vector."""

    def __init__(self, step: Elect, weights: Sequence[float]) -> None:
        self.step = step
        self.weights = torch.tensor(weights, dtype=torch.float32)[:, None] if weights else None
        self.balance = 0.0  # entries that elect plus, less those that elect minus
        self.undecided: list[Piece] = []

    def write(self, stack: torch.Tensor, out: torch.Tensor, piece: Piece) -> None:
        signs = self._signs(stack)
        if self.step.zero == "plus":
            signs = torch.where(signs == 0, 1.0, signs)
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
            self._combine(stack, torch.where(signs == 0, majority, signs), out[piece.start : piece.stop])

    def _signs(self, stack: torch.Tensor) -> torch.Tensor:
        if self.weights is not None:
            stack.mul_(self.weights)
        return stack.sum(dim=0).sign_()

    @staticmethod
    def _cancels(stack: torch.Tensor, signs: torch.Tensor) -> bool:
        """True where entries that are not 0 sum to 0: with all at 0 the sign does not matter."""
        empty = signs == 0
        return bool(empty.any()) and bool((stack[:, empty] != 0).any())

    def _combine(self, stack: torch.Tensor, signs: torch.Tensor, out: torch.Tensor) -> None:
        agreeing = stack.mul_(signs).clamp_(min=0.0)  # magnitudes of those that agree, 0 for the others
        torch.sum(agreeing, dim=0, out=out)
        if self.step.combine == "mean":
            voices = agreeing.sign_() if self.weights is None else agreeing.sign_().mul_(self.weights)
            out.div_(torch.where(out == 0, 1.0, voices.sum(dim=0)))
        out.mul_(signs)
