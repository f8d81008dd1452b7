"""A pool of eleven NMRF Swin-T networks."""

from __future__ import annotations

from bigpool import measure, table
from processes import shown

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """The table."""
    result = measure("nmrf-swint")
    most = max(row["anonymous_mb"] for row in result["rows"] if row["step"] != "average")
    return f"""## Eleven NMRF Swin-T sources

`{shown("bigpool.py", "nmrf-swint")}`: 12 files of {result["file_bytes"] / 1e6:.0f} MB with random weights;
the evaluation is of one rendered pair of 96 x 160, in seconds a recipe. Every step runs in a process of its
own.

{table(result)}

The most anonymous memory in any step of ours was {most:,.0f} MiB, Python and torch included."""
