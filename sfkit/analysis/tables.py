"""Tables with their best marked: in notebooks, as LaTeX (booktabs), and as files."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sfkit.analysis.measured import Measured
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.separation import column_name
from sfkit.evaluation.table import write_table
from sfkit.files import write_text
from sfkit.merging.recipe import Recipe

if TYPE_CHECKING:
    from pandas.io.formats.style import Styler

BEST, SECOND = "best", "second"
_MARKS = {BEST: r"\textbf{%s}", SECOND: r"\underline{%s}", "": "%s"}
# In one pass: one after the other, the first one's backslashes would be escaped again.
_SPECIAL = str.maketrans(
    {
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
)


def source_table(measured: Sequence[Measured], *, metric: str | None = None) -> pd.DataFrame:
    """The paper's big table of individual checkpoints: a row a benchmark, a column a network.

    Rows bear protocol, metric and unit, and ``*`` where the benchmark guided a search.

    Raises:
        InputError: no benchmark, or an unknown metric.
    """
    if not measured:
        raise InputError("sources: found no benchmark, expected at least one that networks were measured on")
    rows = {}
    for one in measured:
        kind = (one.protocol, metric or one.metric, one.unit_of(metric))
        name = column_name(one.benchmark, *kind, guided=one.validation)
        rows[name] = {network: one.score(network, metric=metric) for network in one.networks}
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.index.name = "benchmark"
    return table


def recipe_table(recipe: Recipe) -> pd.DataFrame:
    """A row a block: the weight of each source (0 to 1, of the base where nothing is mixed) and the scale."""
    rows = [
        {**dict(zip(recipe.sources, weights, strict=True)), "scale": scale}
        for weights, scale in zip(recipe.weights, recipe.scales, strict=True)
    ]
    return pd.DataFrame(rows, index=pd.Index(recipe.blocks, name="block"))


def ranks(
    table: pd.DataFrame,
    *,
    along: str = "row",
    columns: Sequence[str] | None = None,
    lower_is_better: bool = True,
) -> pd.DataFrame:
    """``best``, ``second`` or empty for each cell; ties share a mark.

    Args:
        table: numbers; other columns are left unmarked, and so is NaN.
        along: ``row`` compares the cells of each row, ``column`` those of each column.
        columns: the columns to mark; all numeric ones unless given.
        lower_is_better: of the numbers' metric.

    Raises:
        InputError: another word than these.
    """
    ensure_known("way to compare", along, ("row", "column"))
    chosen = list(columns if columns is not None else table.select_dtypes("number").columns)
    marks = pd.DataFrame("", index=table.index, columns=table.columns)
    # Turned around where more is better: one order serves both.
    values = table[chosen].to_numpy(np.float64) * (1.0 if lower_is_better else -1.0)
    lines = values if along == "row" else values.T
    words = np.array([_ranked(line) for line in lines], dtype=object).reshape(lines.shape)
    marks[chosen] = words if along == "row" else words.T
    return marks


def _ranked(line: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[str]:
    # By value, not by place: equal cells share a mark.
    levels = sorted(set(line[np.isfinite(line)].tolist()))
    words = dict(zip(levels, (BEST, SECOND), strict=False))
    return [words.get(float(value), "") for value in line]


def shown(table: pd.DataFrame, *, digits: int = 2) -> Styler:
    """The table for a notebook: numbers with ``digits`` decimals, every name as the text it is.

    pandas escapes the names in a plain table and leaves them as HTML in a styled one.
    """
    # Names alone change, so that values need no copy.
    table = table.copy(deep=False)
    table.index, table.columns = (
        labels.set_names([None if name is None else html.escape(str(name)) for name in labels.names])
        for labels in (table.index, table.columns)
    )
    style = table.style.format(precision=digits, na_rep="–", escape="html")
    for axis in (0, 1):
        style = style.format_index(escape="html", precision=digits, axis=axis)
    return style


def latex_table(
    table: pd.DataFrame,
    *,
    along: str = "row",
    columns: Sequence[str] | None = None,
    digits: int = 2,
    caption: str = "",
    label: str = "",
    marks: pd.DataFrame | None = None,
) -> str:
    """The table as LaTeX for the package booktabs, best bold and second best underlined.

    Args:
        table: rows and columns as they shall stand; text is escaped.
        along: as for :func:`ranks`.
        columns: likewise.
        digits: decimals of numbers.
        caption: below which the table stands; with it or a label the table floats.
        label: to refer to.
        marks: of :func:`ranks`, where they are known; made here unless given.
    """
    found = ranks(table, along=along, columns=columns) if marks is None else marks
    return _latex(table, found, digits, caption, label)


def _latex(table: pd.DataFrame, marks: pd.DataFrame, digits: int, caption: str, label: str) -> str:
    names = [[_escaped(text) for text in row] for row in _names(table)]
    body = _cells(table, marks, digits)
    head = [*names[0], *(_escaped(_heading(column)) for column in table.columns)]
    lines = [[*name, *cells] for name, cells in zip(names[1:], body, strict=True)]
    # Names and words to the left, numbers to the right.
    kinds = "l" * len(names[0]) + "".join("r" if _numeric(table[c]) else "l" for c in table.columns)
    text = "\n".join(
        [
            rf"\begin{{tabular}}{{{kinds}}}",
            r"\toprule",
            " & ".join(head) + r" \\",
            r"\midrule",
            *(" & ".join(line) + r" \\" for line in lines),
            r"\bottomrule",
            r"\end{tabular}",
        ]
    )
    if not caption and not label:
        return text + "\n"
    above = [r"\begin{table}", r"\centering", rf"\caption{{{_escaped(caption)}}}"]
    above += [rf"\label{{{label}}}"] if label else []
    return "\n".join([*above, text, r"\end{table}"]) + "\n"


def _names(table: pd.DataFrame) -> list[list[str]]:
    """The index: its names, then one list a row."""
    names = [str(name or "") for name in table.index.names]
    return [names, *([*map(str, key)] if isinstance(key, tuple) else [str(key)] for key in table.index)]


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

    Several levels of rows or columns become one.

    Args:
        table: rows with a named index.
        folder: where to.
        name: the files' name: letters, digits, ``-`` and ``_``; the LaTeX label is ``tab:NAME``.
        caption: the LaTeX table's.
        digits: decimals of numbers in LaTeX; the CSV has all of them.
        lower_is_better: columns of which LaTeX prints bold whatever prints like the lowest number.

    Raises:
        InputError: another kind of name, or a column that is not in the table.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise InputError(f"table: found the name {name!r}, expected letters, digits, - and _")
    if missing := [column for column in lower_is_better if column not in table.columns]:
        raise InputError(
            f"table {name!r}: found no column {missing[0]!r}, expected some of {', '.join(map(str, table))}"
        )
    # A csv has no index of several levels.
    plain = table.reset_index() if table.index.nlevels > 1 else table
    write_table(plain, Path(folder) / f"{name}.csv")
    flat = table.set_axis([" / ".join(row) for row in _names(table)[1:]])
    flat.index.name = " / ".join(str(level) for level in table.index.names if level)
    # Rounded first: what prints alike is marked alike.
    marks = ranks(table.round(digits), along="column", columns=lower_is_better).set_axis(flat.index)
    text = _latex(flat, marks.replace(SECOND, ""), digits, caption, f"tab:{name}")
    write_text(Path(folder) / f"{name}.tex", text)
    return table


def _heading(column: object) -> str:
    return " ".join(map(str, column)) if isinstance(column, tuple) else str(column)


def _escaped(text: object) -> str:
    return str(text).translate(_SPECIAL)


def _cells(table: pd.DataFrame, marks: pd.DataFrame, digits: int) -> list[list[str]]:
    # Column by column: a whole number stays one beside columns of fractions.
    columns = [list(table.iloc[:, place]) for place in range(table.shape[1])]
    rows = zip(zip(*columns, strict=True), marks.to_numpy(), strict=True)
    return [[_cell(value, mark, digits) for value, mark in zip(*row, strict=True)] for row in rows]


def _cell(value: object, mark: str, digits: int) -> str:
    if value is None or value is pd.NA or value != value:  # the NA of whole numbers; NaN
        cell = "--"
    elif isinstance(value, float | np.floating):
        cell = f"{value:.{digits}f}"
    elif isinstance(value, int | np.integer) and not isinstance(value, bool):
        cell = f"{value:,}".replace(",", r"\,")
    else:
        cell = _escaped(value)
    return _MARKS[mark] % cell


def _numeric(column: pd.Series) -> bool:
    return pd.api.types.is_numeric_dtype(column) and column.dtype != bool
