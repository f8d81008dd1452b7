"""Tables of the documents: frames, and rows of text and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd


def markdown_lines(
    head: Sequence[str], rows: Iterable[Sequence[object]], right: Sequence[bool] | None = None
) -> str:
    """Rows of text as a Markdown table, as they are; ``right`` says which columns stand right."""
    rule = ["--:" if one else "---" for one in right or [False] * len(head)]
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (head, rule, *rows))


def numbers(heads: Sequence[str], rows: Iterable[Sequence[object]], texts: int = 1) -> str:
    """Rows as Markdown, as they are; all but the first ``texts`` columns are numbers and stand right."""
    return markdown_lines(heads, rows, [number >= texts for number in range(len(heads))])


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """A table as Markdown, nothing marked; a number that is missing is a dash."""
    head = [*(str(name or "") for name in table.index.names), *map(_heading, table.columns)]
    names = [map(str, key) if isinstance(key, tuple) else [str(key)] for key in table.index]
    # Column by column: a whole number stays one beside columns of fractions.
    cells = zip(*([_cell(v, digits) for v in table.iloc[:, n]] for n in range(table.shape[1])), strict=True)
    plain = pd.api.types
    right = [plain.is_numeric_dtype(k) and not plain.is_bool_dtype(k) for k in table.dtypes]
    rows = [[*name, *row] for name, row in zip(names, cells, strict=True)]
    return markdown_lines(head, rows, [False] * table.index.nlevels + right)


def _heading(column: object) -> str:
    return " ".join(map(str, column)) if isinstance(column, tuple) else str(column)


def _cell(value: object, digits: int) -> str:
    if value is None or value is pd.NA or value != value:  # the NA of whole numbers; NaN
        return "–"
    return f"{value:.{digits}f}" if isinstance(value, float | np.floating) else str(value)


def percent(share: float) -> str:
    """In whole percent, of more digits where what is neither none nor all would read as if it were."""
    digits = 0
    while float(text := f"{100 * share:.{digits}f}") in (0.0, 100.0) and share not in (0.0, 1.0):
        digits += 1
    return f"{text} %"
