"""Tables of the full report, for the sections that record it."""

from __future__ import annotations

import pandas as pd

from sfkit.analysis import markdown_table


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """A table as Markdown, nothing marked; a number that is missing is a dash."""
    return markdown_table(table, columns=(), digits=digits).strip()
