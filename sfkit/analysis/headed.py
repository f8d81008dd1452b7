"""Tables as a page shows them: benchmark over metric, best bold, second underlined, LaTeX behind a fold.

A table of scores is a plain frame whose columns bear the labels of its benchmarks; :class:`ShownTable` gives
it the two lines of heads that papers print, and :func:`publish_table` leaves it as files besides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd

from sfkit.analysis.comparisons import ComparedColumn
from sfkit.analysis.tables import BEST, SECOND, export_table, latex_table, ranks
from sfkit.datasets.metric import Metric
from sfkit.evaluation.separation import GUIDED, marked

MEAN, UNSEEN = "mean", "mean of the unseen"
"""Columns of every table of scores: over all benchmarks, as the paper has it, and over what guided none."""

_HEADS = {MEAN: (MEAN, "of all"), UNSEEN: (MEAN, "of the unseen")}
WIDE = 10
"""Columns from which a page writes smaller, so that the paper's table of 11 sources fits."""
_TAGS = {BEST: "b", SECOND: "u"}


@dataclass(frozen=True, eq=False)
class ShownTable:
    """One table on a page; a notebook shows it as HTML.

    Attributes:
        table: rows with a named index, or one without a name, which is not shown.
        heads: column -> the two lines above it; a line that neighbours share is written once.
        marks: ``best``, ``second`` or empty for each cell.
        digits: decimals of numbers.
        caption: stands above; empty for none.
        note: a sentence below; empty for none.
    """

    table: pd.DataFrame
    heads: Mapping[str, tuple[str, str]]
    marks: pd.DataFrame
    digits: int = 2
    caption: str = ""
    note: str = ""

    def head(self, column: object) -> tuple[str, str]:
        """The two lines above a column."""
        return self.heads.get(str(column), (str(column), ""))

    @property
    def latex(self) -> str:
        """The table for the package booktabs, with the same marks."""
        flat = self.table.set_axis([" ".join(filter(None, self.head(c))) for c in self.table], axis=1)
        marks = self.marks.set_axis(flat.columns, axis=1)
        return latex_table(flat, marks=marks, digits=self.digits, caption=self.caption)

    def _repr_html_(self) -> str:
        caption = f"<caption>{escape(self.caption)}</caption>" if self.caption else ""
        note = f'<p class="note">{escape(self.note)}</p>' if self.note else ""
        head, rows = "".join(self._head()), "\n".join(self._rows())
        wide = " wide" if self.table.shape[1] >= WIDE else ""
        return (
            f'<div class="shown-table{wide}"><div class="scroll"><table>{caption}\n'
            f"<thead>{head}</thead>\n<tbody>\n{rows}\n</tbody></table></div>{note}"
            f"<details><summary>LaTeX</summary><pre>{escape(self.latex)}</pre></details></div>"
        )

    def _head(self) -> Iterator[str]:
        """One line, or two where a column has a second; what has none spans both."""
        heads = [self.head(column) for column in self.table.columns]
        down = 2 if any(lower for _, lower in heads) else 1
        first = [
            f'<th scope="col" class="text" rowspan="{down}">{escape(str(name))}</th>' for name in self._index
        ]
        lower: list[str] = []
        # Neighbours alone share a head; the same word farther right begins another group.
        for upper, group in groupby(enumerate(heads), key=lambda pair: pair[1][0]):
            places = [place for place, _ in group]
            # A head without a lower one spans both lines.
            alone = not any(heads[place][1] for place in places)
            span = f' rowspan="{down}"' if alone else f' colspan="{len(places)}"'
            kind = self._kind(places[0])
            first.append(f'<th scope="col"{kind}{span}>{escape(upper)}</th>')
            if not alone:
                below = (f'<th scope="col"{self._kind(p)}>{escape(heads[p][1])}</th>' for p in places)
                lower += below
        yield f"<tr>{''.join(first)}</tr>"
        if down == 2:
            yield f"<tr>{''.join(lower)}</tr>"

    @property
    def _index(self) -> list[str]:
        names = list(self.table.index.names)
        return [] if names == [None] else [str(name or "") for name in names]

    def _rows(self) -> Iterator[str]:
        # Column by column: a row of several types would turn whole numbers into fractions.
        columns = [list(self.table.iloc[:, place]) for place in range(self.table.shape[1])]
        for key, values, marks in zip(
            self.table.index, zip(*columns, strict=True), self.marks.to_numpy(), strict=True
        ):
            names = key if isinstance(key, tuple) else (key,)
            heads = "".join(f'<th scope="row">{escape(str(n))}</th>' for n in names) if self._index else ""
            cells = "".join(
                f"<td{self._kind(place, key)}>{self._cell(value, mark)}</td>"
                for place, (value, mark) in enumerate(zip(values, marks, strict=True))
            )
            yield f"<tr>{heads}{cells}</tr>"

    def _cell(self, value: object, mark: str) -> str:
        text = escape(_cell_text(value, self.digits))
        return f"<{_TAGS[mark]}>{text}</{_TAGS[mark]}>" if mark in _TAGS else text

    def _kind(self, place: int, row: object = None) -> str:
        """Text stands left; what guided is tinted by the page: a column, or the cells of rows with guides."""
        column = self.table.iloc[:, place]
        kinds = [] if pd.api.types.is_numeric_dtype(column) and column.dtype != bool else ["text"]
        name, own = str(self.table.columns[place]), _guide(self.table.index.name, row)
        if self.head(name)[0].endswith(GUIDED) or name == own:
            kinds.append("guided")
        return f' class="{" ".join(kinds)}"' if kinds else ""


def _guide(index: object, row: object) -> str | None:
    """The benchmark that guided a row of :mod:`~sfkit.analysis.ablations`; None in other tables."""
    if row is None or index not in ("guided by", "fitness"):
        return None
    return str(row) if index == "guided by" else str(row).rpartition(" ")[0]  # of BENCHMARK METRIC


def shown_table(
    table: pd.DataFrame,
    columns: Sequence[ComparedColumn] = (),
    *,
    along: str = "column",
    best: Sequence[str] | None = None,
    digits: int = 2,
    caption: str = "",
    note: str = "",
) -> ShownTable:
    """A table for a page.

    Args:
        table: rows with a named index.
        columns: the benchmarks whose scores its columns hold; those get their metric below their name.
        along: ``column`` marks the best of each column, ``row`` that of each row.
        best: the columns to mark; those of scores unless given.
        digits: decimals of numbers.
        caption: stands above.
        note: stands below.

    Raises:
        InputError: another word for ``along``.
    """
    heads = _HEADS | {label: head for one in columns for label, head in _labels(one)}
    chosen = [c for c in table.columns if str(c) in heads] if best is None else list(best)
    # Of what is shown: numbers that are equal on the page are equally good.
    marks = ranks(table.round(digits), along=along, columns=chosen)
    return ShownTable(table, heads, marks, digits, caption, note)


def publish_table(
    table: pd.DataFrame,
    name: str,
    caption: str,
    columns: Sequence[ComparedColumn] = (),
    *,
    folder: str | Path,
    along: str = "column",
    best: Sequence[str] | None = None,
    digits: int = 2,
) -> ShownTable:
    """Leave ``NAME.csv`` and ``NAME.tex`` in ``folder``, and show the table; arguments as elsewhere here.

    Raises:
        InputError: as :func:`~sfkit.analysis.tables.export_table` and :func:`shown_table`.
    """
    shown = shown_table(table, columns, along=along, best=best, digits=digits, caption=caption)
    # The file marks columns alone; marks along rows are the page's.
    lower = [str(c) for c in table.columns if (shown.marks[c] != "").any()] if along == "column" else []
    export_table(table, folder, name, caption=caption, digits=digits, lower_is_better=lower)
    return shown


def _labels(one: ComparedColumn) -> Iterator[tuple[str, tuple[str, str]]]:
    """What a table may call the benchmark's column, and its two lines of head."""
    metric = Metric.parse(one.metric)
    below = f"{metric.label} ({metric.unit})"
    for guided in (True, False):
        yield marked(one.benchmark, guided), (marked(one.benchmark, guided), below)
    yield one.label, (marked(one.benchmark, one.validation), below)


def with_means(table: pd.DataFrame, columns: Sequence[ComparedColumn], unseen: Sequence[str]) -> pd.DataFrame:
    """The table with the means over all its benchmarks and over the ``unseen``; NaN where metrics are not of
    one kind, such as percents of pixels and of census bits.

    Args:
        table: its columns are the benchmarks' names.
        columns: the benchmarks.
        unseen: names of those that guided nothing.
    """
    mean = partial(_mean, table, {one.benchmark: Metric.parse(one.metric).kind for one in columns})
    return table.assign(**{MEAN: mean([one.benchmark for one in columns]), UNSEEN: mean(list(unseen))})


def _mean(table: pd.DataFrame, kinds: Mapping[str, tuple[str, bool]], names: list[str]) -> pd.Series | float:
    one_kind = len({kinds[name] for name in names}) == 1
    return table[names].mean(axis=1, skipna=False) if one_kind else np.nan


def _cell_text(value: object, digits: int) -> str:
    if value is None or value is pd.NA or value != value:
        return "–"
    # Before whole numbers, which Python counts truth values among.
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        # A minus sign is as wide as a figure; a hyphen would shift the column.
        return f"{value:.{digits}f}".replace("-", "−")
    if isinstance(value, int | np.integer):
        return f"{value:,}"
    return str(value)


def score_rows(table: pd.DataFrame, columns: Sequence[ComparedColumn]) -> pd.DataFrame:
    """A table of scores as rows (network, benchmark), for :func:`~sfkit.analysis.scores.score_grid`.

    Args:
        table: a row a network, its columns labelled as :class:`ShownTable` knows them; others are left out.
        columns: the benchmarks.
    """
    labels = {label: one for one in columns for label, _ in _labels(one)} | {c.benchmark: c for c in columns}
    found = [(c, labels[str(c)]) for c in table.columns if str(c) in labels]
    return pd.DataFrame(
        {
            "network": ", ".join(map(str, key)) if isinstance(key, tuple) else str(key),
            "benchmark": one.benchmark,
            "metric": one.metric,
            "unit": one.unit,
            "score": score,
            "role": "validation" if str(column).endswith(GUIDED) else "reported",
        }
        for column, one in found
        for key, score in table[column].items()
    )
