"""Tables as files: CSV to compute with, LaTeX (booktabs) to print."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.table import write_table
from sfkit.files import write_text

_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "±": r"$\pm$",
    "≥": r"$\geq$",
    "σ": r"$\sigma$",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def export_table(
    table: pd.DataFrame,
    folder: str | Path,
    name: str,
    *,
    caption: str = "",
    digits: int = 2,
    lower_is_better: Sequence[str] = (),
) -> pd.DataFrame:
    """Write ``NAME.csv`` and ``NAME.tex`` into ``folder``, which is made, and return the table as it was.

    Args:
        table: rows with a named index.
        folder: where to.
        name: the files' name: letters, digits, ``-`` and ``_``; the LaTeX label is ``tab:NAME``.
        caption: the LaTeX table's.
        digits: decimals of numbers in LaTeX; the CSV has all of them.
        lower_is_better: columns whose lowest number LaTeX prints bold.

    Raises:
        InputError: another kind of name, or a column that is not in the table.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise InputError(f"table: found the name {name!r}, expected letters, digits, - and _")
    if missing := [column for column in lower_is_better if column not in table.columns]:
        raise InputError(
            f"table {name!r}: found no column {missing[0]!r}, expected some of {', '.join(map(str, table))}"
        )
    plain = table.reset_index() if table.index.nlevels > 1 else table
    write_table(plain, Path(folder) / f"{name}.csv")
    text = latex_table(table, label=name, caption=caption, digits=digits, lower_is_better=lower_is_better)
    write_text(Path(folder) / f"{name}.tex", text)
    return table


def latex_table(
    table: pd.DataFrame,
    *,
    label: str,
    caption: str = "",
    digits: int = 2,
    lower_is_better: Sequence[str] = (),
) -> str:
    r"""A ``table`` environment with booktabs rules; numbers stand right, everything else left.

    Only ``\usepackage{booktabs}`` is needed. A number that is missing is a dash.
    """
    levels = table.index.nlevels
    index = [" / ".join(map(str, row)) if levels > 1 else str(row) for row in table.index]
    heads = [" / ".join(str(name) for name in table.index.names if name), *map(_heading, table.columns)]
    columns = [list(table[column]) for column in table]
    numeric = [pd.api.types.is_numeric_dtype(table[c]) and table[c].dtype != bool for c in table]
    cells = [[_cell(value, digits) for value in column] for column in columns]
    for place, column in enumerate(table.columns):
        if column in lower_is_better:
            _embolden(cells[place], columns[place])
    rows = [
        " & ".join([_escaped(row), *texts])
        for row, texts in zip(index, zip(*cells, strict=True), strict=True)
    ]
    layout = "l" + "".join("r" if is_number else "l" for is_number in numeric)
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{_escaped(caption)}}}",
            rf"\label{{tab:{label}}}",
            rf"\begin{{tabular}}{{{layout}}}",
            r"\toprule",
            " & ".join(map(_escaped, heads)) + r" \\",
            r"\midrule",
            *(row + r" \\" for row in rows),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _heading(column: object) -> str:
    return " ".join(map(str, column)) if isinstance(column, tuple) else str(column)


def _cell(value: object, digits: int) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _escaped(str(value)) if value is not None else "--"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\\,")
    return f"{value:.{digits}f}" if math.isfinite(value) else "--"


def _embolden(texts: list[str], values: Iterable[object]) -> None:
    """Every cell that prints like the lowest number."""
    finite = [float(v) for v in values if isinstance(v, int | float) and math.isfinite(v)]
    if not finite:
        return
    lowest = min((float(text), text) for text in texts if re.fullmatch(r"-?\d+(\.\d+)?", text))[1]
    texts[:] = [rf"\textbf{{{text}}}" if text == lowest else text for text in texts]


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(character, character) for character in text)
