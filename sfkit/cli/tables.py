"""Tables in a terminal: numbers rounded and to the right, and no line longer than eighty columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

WIDTH = 80


def lines(
    heads: Sequence[str], rows: Sequence[Sequence[str | float | None]], *, digits: Mapping[str, int]
) -> list[str]:
    """The table as lines; texts that would make one too long are cut from the left, where paths are alike.

    Args:
        heads: the columns.
        rows: a value a column; None is shown as ``-``.
        digits: column -> decimals of its numbers; whole unless given.
    """
    texts = [
        [_text(value, digits.get(head, 0)) for head, value in zip(heads, row, strict=True)] for row in rows
    ]
    widths = [max([len(head), *(len(row[n]) for row in texts)]) for n, head in enumerate(heads)]
    numeric = [all(not isinstance(row[n], str) for row in rows) for n in range(len(heads))]
    # Two blanks stand between columns.
    excess = sum(widths) + 2 * (len(widths) - 1) - WIDTH
    # The widest text gives way first; numbers stay whole.
    for n in sorted(range(len(heads)), key=lambda n: -widths[n]):
        if excess > 0 and not numeric[n]:
            least = max(len(heads[n]), 8)
            cut = min(excess, max(widths[n] - least, 0))
            widths[n], excess = widths[n] - cut, excess - cut
    return [_line(row, widths, numeric) for row in (list(heads), *texts)]


def _text(value: str | float | None, digits: int) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.{digits}f}"


def _line(row: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> str:
    cut = [
        # From the left: paths differ at their ends.
        text if len(text) <= width else "…" + text[1 - width :]
        for text, width in zip(row, widths, strict=True)
    ]
    cells = [
        text.rjust(width) if right else text.ljust(width)
        for text, width, right in zip(cut, widths, numeric, strict=True)
    ]
    return "  ".join(cells).rstrip()
