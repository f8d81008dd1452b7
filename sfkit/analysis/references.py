"""The paper's rows beside one's own, where benchmark and metric are the same."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from sfkit.analysis.comparisons import ComparedColumn
from sfkit.analysis.headed import MEAN
from sfkit.evaluation.separation import marked
from sfkit.published.tables import BENCHMARKS, published

PUBLISHED = "‡"
"""Stands behind a row that the paper prints: other checkpoints, another machine, perhaps another protocol."""

METRICS = dict(zip(BENCHMARKS, ("d1", "d1", "bad-2.0", "bad-1.0"), strict=True))
"""What the paper reports each benchmark by."""


def reference_columns(columns: Sequence[ComparedColumn]) -> tuple[ComparedColumn, ...]:
    """Those of the columns that the paper reports, by the same metric."""
    return tuple(one for one in columns if METRICS.get(one.benchmark) == one.metric)


def reference_rows(columns: Sequence[ComparedColumn], label: str = "tab:zero_shot") -> pd.DataFrame:
    """The rows of one of the paper's tables on the benchmarks that are shown here under the paper's metric.

    A row ``NAME ‡`` is another's number, to be read beside one's own and not compared to the digit; the mean
    is there where all four benchmarks are. The frame is empty where none is.

    Args:
        columns: what one's own table shows.
        label: of a table whose columns are the four benchmarks.

    Raises:
        InputError: the paper has no such table.
    """
    shared = [one.benchmark for one in reference_columns(columns)]
    table = published(label)
    if not shared:
        return pd.DataFrame()
    # Levels of one name say it once.
    names = [" ".join(dict.fromkeys(key)) if isinstance(key, tuple) else str(key) for key in table.index]
    rows = table.set_axis([f"{name} {PUBLISHED}" for name in names])[shared]
    # The paper's mean is over its four benchmarks, and compares with no other.
    if set(BENCHMARKS) == {c.benchmark for c in columns}:
        rows = rows.assign(**{MEAN: table["mean"].to_numpy()})
    return rows.rename_axis("method")


def with_references(
    table: pd.DataFrame, columns: Sequence[ComparedColumn], label: str = "tab:zero_shot"
) -> pd.DataFrame:
    """One's own rows, then those of :func:`reference_rows`; cells the paper has not are empty.

    Args:
        table: a row a network, columns labelled as :meth:`~sfkit.analysis.study.Study.table` does.
        columns: its benchmarks.
        label: as there.

    Raises:
        InputError: as there.
    """
    rows = reference_rows(columns, label)
    if rows.empty:
        return table
    heads = {}
    for one in columns:
        names = (one.label, marked(one.benchmark, one.validation), one.benchmark)
        # A heading may carry a metric or a mark: the table's own form of it is taken.
        heads[one.benchmark] = next(name for name in names if name in table.columns)
    joined = pd.concat([table, rows.rename(columns=heads)])
    own: pd.DataFrame = joined[[*table.columns]]
    own.index.name = table.index.name
    return own
