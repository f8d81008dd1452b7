"""Tables with their best and second best marked: for notebooks, LaTeX (booktabs) and Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sfkit.analysis.measured import Measured
from sfkit.errors import InputError, unknown_name

if TYPE_CHECKING:
    from pandas.io.formats.style import Styler

BEST, SECOND = "best", "second"
_CSS = {BEST: "font-weight: bold", SECOND: "text-decoration: underline"}
_LATEX = {BEST: r"\textbf{%s}", SECOND: r"\underline{%s}", "": "%s"}
_MARKDOWN = {BEST: "**%s**", SECOND: "_%s_", "": "%s"}
_SPECIAL = str.maketrans({c: f"\\{c}" for c in "&%$#_{}"})


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
        mark = " *" if one.validation else ""
        name = f"{one.benchmark} ({one.protocol}) {metric or one.metric} [{one.unit_of(metric)}]{mark}"
        rows[name] = {network: one.score(network, metric=metric) for network in one.networks}
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.index.name = "benchmark"
    return table


def ranks(table: pd.DataFrame, *, along: str = "row", columns: Sequence[str] | None = None) -> pd.DataFrame:
    """``best``, ``second`` or empty for each cell; lower is better, ties share a mark.

    Args:
        table: numbers; other columns are left unmarked, and so is NaN.
        along: ``row`` compares the cells of each row, ``column`` those of each column.
        columns: the columns to mark; all numeric ones unless given.

    Raises:
        InputError: another word than these.
    """
    if along not in ("row", "column"):
        raise unknown_name("way to compare", along, ("row", "column"))
    chosen = list(columns if columns is not None else table.select_dtypes("number").columns)
    marks = pd.DataFrame("", index=table.index, columns=table.columns)
    values = table[chosen].to_numpy(np.float64)
    lines = values if along == "row" else values.T
    words = np.array([_ranked(line) for line in lines], dtype=object).reshape(lines.shape)
    marks[chosen] = words if along == "row" else words.T
    return marks


def _ranked(line: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[str]:
    levels = sorted(set(line[np.isfinite(line)].tolist()))
    words = dict(zip(levels, (BEST, SECOND), strict=False))
    return [words.get(float(value), "") for value in line]


def styled(
    table: pd.DataFrame, *, along: str = "row", columns: Sequence[str] | None = None, digits: int = 2
) -> Styler:
    """The table for a notebook: best bold, second best underlined, numbers with ``digits`` decimals."""
    marks = ranks(table, along=along, columns=columns)
    css = marks.map(lambda mark: _CSS.get(mark, ""))
    return table.style.format(precision=digits, na_rep="–").apply(lambda _: css, axis=None)


def latex_table(
    table: pd.DataFrame,
    *,
    along: str = "row",
    columns: Sequence[str] | None = None,
    digits: int = 2,
    caption: str = "",
    label: str = "",
) -> str:
    """The table as LaTeX for the package booktabs, best bold and second best underlined.

    Args:
        table: rows and columns as they shall stand; text is escaped.
        along: as for :func:`ranks`.
        columns: likewise.
        digits: decimals of numbers.
        caption: below which the table stands; with it or a label the table floats.
        label: to refer to.
    """
    rows = [[text.translate(_SPECIAL) for text in row] for row in _names(table)]
    body = _cells(table, ranks(table, along=along, columns=columns), digits, _LATEX, escape=True)
    head = [*rows[0], *(str(column).translate(_SPECIAL) for column in table.columns)]
    lines = [[*names, *cells] for names, cells in zip(rows[1:], body, strict=True)]
    kinds = "l" * len(rows[0]) + "".join("r" if _numeric(table[c]) else "l" for c in table.columns)
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
    extra = [rf"\caption{{{caption.translate(_SPECIAL)}}}"] if caption else []
    extra += [rf"\label{{{label}}}"] if label else []
    return "\n".join([r"\begin{table}", r"\centering", *extra, text, r"\end{table}"]) + "\n"


def markdown_table(
    table: pd.DataFrame, *, along: str = "row", columns: Sequence[str] | None = None, digits: int = 2
) -> str:
    """The table as Markdown, best bold and second best in italics."""
    names = _names(table)
    body = _cells(table, ranks(table, along=along, columns=columns), digits, _MARKDOWN, escape=False)
    head = [*names[0], *map(str, table.columns)]
    rule = ["---"] * len(names[0]) + ["--:" if _numeric(table[c]) else "---" for c in table.columns]
    rows = [head, rule, *([*name, *cells] for name, cells in zip(names[1:], body, strict=True))]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def _names(table: pd.DataFrame) -> list[list[str]]:
    """The index: its names, then one list a row."""
    names = [str(name or "") for name in table.index.names]
    return [names, *([*map(str, key)] if isinstance(key, tuple) else [str(key)] for key in table.index)]


def _cells(
    table: pd.DataFrame, marks: pd.DataFrame, digits: int, forms: dict[str, str], *, escape: bool
) -> list[list[str]]:
    def cell(value: object, mark: str) -> str:
        if isinstance(value, float | np.floating):
            text = f"{value:.{digits}f}" if np.isfinite(value) else "–" if np.isnan(value) else "inf"
        else:
            text = str(value).translate(_SPECIAL) if escape else str(value)
        return forms[mark] % text

    rows = zip(table.to_numpy(dtype=object), marks.to_numpy(), strict=True)
    return [[cell(value, mark) for value, mark in zip(*row, strict=True)] for row in rows]


def _numeric(column: pd.Series) -> bool:
    return pd.api.types.is_numeric_dtype(column)
