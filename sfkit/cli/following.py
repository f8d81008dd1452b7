"""Long work, followed piece by piece: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from sfkit.cli.terminal import Bars, say

Piece = TypeVar("Piece")


def followed(
    pieces: Iterable[Piece], line: Callable[[int, Piece], str | None], *, total: int | None, what: str
) -> Iterator[Piece]:
    """Pass the pieces on as they come, and say each on standard error.

    Args:
        pieces: what is made one after another.
        line: the number of a piece, from 1, and the piece -> what is said of it; None for nothing.
        total: how many there will be; None where nobody knows.
        what: stands before the bar.
    """
    with Bars() as bars:
        for number, piece in enumerate(pieces, 1):
            if (text := line(number, piece)) is not None:
                say(text)
            bars(what, number, total)
            yield piece
