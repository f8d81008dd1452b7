"""What people read while a command works: lines and bars on standard error, in colour at a terminal.

Every command that takes long has one :class:`Bars`: at a terminal a bar with the time left, elsewhere plain
lines. Colour follows https://no-color.org.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, TextIO, TypeVar

import typer

if TYPE_CHECKING:
    from tqdm import tqdm

Piece = TypeVar("Piece")
# Control characters but for tab and line feed, marks that turn the order of letters, bytes that are no UTF-8.
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
_COLOURS = {"error": "red", "warning": "yellow", "better": "green", "worse": "red", "within noise": "yellow"}
_WORDS = re.compile(
    r"^(?:error|warning)(?=:)|\b(?:better|worse)(?= than)|\bwithin noise(?= of)", re.MULTILINE
)
_SHAPE = "{desc} {percentage:3.0f} % |{bar}| {n:.0f} of {total:.0f}, {elapsed}, {remaining} left{postfix}"

_STEP = re.compile(r"(?P<step>.+?):? (?:step )?(?P<done>\d+) of (?P<total>\d+)(?:[,:] (?P<note>.*))?")
_COUNT = "{desc} {n:.0f}, {elapsed}{postfix}"

_shown: dict[str, tqdm[None]] = {}
"""The bars that are on the screen, by their steps: lines are written above them."""
_turn = threading.RLock()
"""Trainings side by side are read by a thread each; one at a time has the screen."""


def printable(text: str) -> str:
    """The text, with what a terminal would obey or cannot show written as escapes, as in a file's name."""
    return _UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def coloured(text: str, stream: TextIO) -> str:
    """The text with what it says of errors and differences in colour, where the stream is a terminal."""
    if not at_terminal(stream) or os.environ.get("NO_COLOR"):
        return text
    return _WORDS.sub(lambda found: typer.style(found[0], fg=_COLOURS[found[0]], bold=True), text)


def at_terminal(stream: TextIO) -> bool:
    """Whether somebody looks at it who can be shown more than lines."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def say(text: str) -> None:
    """A line of progress on standard error, above the bars where there are any."""
    with _turn:
        for bar in _shown.values():
            bar.clear()
        typer.echo(coloured(printable(text), sys.stderr), err=True)
        for bar in _shown.values():
            bar.refresh()


class Bars:
    """The progress of one command: a bar a step at a terminal, plain lines elsewhere::

        with Bars() as bars:
            bars("Stage 1", 50, 800, "best 12.3 %", line="Stage 1, generation 0: best 12.3 %")

    Args:
        keep: whether the bars of finished steps stay on the screen.
        side_by_side: whether steps are done at the same time; else a step ends where another begins.
    """

    def __init__(self, *, keep: bool = True, side_by_side: bool = False) -> None:
        self._keep, self._side_by_side = keep, side_by_side
        self._drawn = at_terminal(sys.stderr)
        self._done: dict[str, float] = {}

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        with _turn:
            self._close(*_shown)

    def __call__(
        self, step: str, done: float, total: float | None, note: str = "", *, line: str | None = None
    ) -> None:
        """So much of a step is done.

        Args:
            step: its name.
            done: of it, in whatever unit.
            total: all of it; None where nobody knows.
            note: what to show beside a bar, such as the best score so far.
            line: what to say where there are no bars; nothing unless given.
        """
        if not self._drawn:
            if line is not None:
                say(line)
            return
        with _turn:
            if not self._side_by_side:
                # One step after the other: that before is done.
                self._close(*(other for other in _shown if other != step))
            self._done[step] = done
            bar = _shown[step] if step in _shown else self._bar(step, total)  # a bar may have no truth value
            # More than was foreseen: the bar is full then, and not fuller.
            bar.total, bar.n = total and max(total, done), done
            bar.set_postfix_str(printable(note))
            if total is not None and done >= total:
                self._close(step)

    def show(self, line: str) -> None:
        """A line such as ``kitti: step 50 of 300, loss 0.12``: a bar at a terminal, else said as it is."""
        found = _STEP.fullmatch(line)
        if found is None:
            say(line)
        else:
            self(found["step"], int(found["done"]), int(found["total"]), found["note"] or "", line=line)

    def within(self, done: float, total: float) -> None:
        """So many of the networks are scored that the step under way asked for; without bars nothing."""
        for step, bar in tuple(_shown.items()):
            bar.n = min(self._done[step] + done, bar.total) if total and bar.total else bar.n
            bar.refresh()

    def _bar(self, step: str, total: float | None) -> tqdm[None]:
        from tqdm import tqdm

        colour = None if os.environ.get("NO_COLOR") else "green"
        name = printable(step)
        bar = tqdm(
            total=total,
            desc=name,
            bar_format=_SHAPE if total is not None else _COUNT,
            dynamic_ncols=True,
            leave=self._keep,
            colour=colour,
            file=sys.stderr,
        )
        _shown[step] = bar
        return bar

    def _close(self, *steps: str) -> None:
        for step in steps:
            _shown.pop(step).close()


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
