"""Long work, followed piece by piece: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from sfkit.cli.options import printable, say

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
    if not sys.stderr.isatty():
        for number, piece in enumerate(pieces, 1):
            if (text := line(number, piece)) is not None:
                say(text)
            yield piece
        return
    from rich import progress as rich
    from rich.console import Console

    columns = (rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn())
    with rich.Progress(*columns, rich.TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task(what, total=total)
        for number, piece in enumerate(pieces, 1):
            if (text := line(number, piece)) is not None:
                bar.console.print(printable(text), markup=False, highlight=False, soft_wrap=True)
            bar.advance(task)
            yield piece
