"""A pool of eleven FoundationStereo ViT-L networks on a small machine."""

from __future__ import annotations

from bigpool import PLANS, TARGET_MB, measure, table
from processes import shown

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """The table, and whether the target for anonymous memory was met."""
    result = measure(PLANS["vitl"])
    rows = result["rows"]
    most = max(row["anonymous_mb"] for row in rows if row["sources"] == 11)
    plain = next(row for row in rows if row["step"] == "average")
    opened = next(row for row in rows if row["step"] == "open first")
    verdict = "under" if most < TARGET_MB else "above"
    return f"""## Eleven FoundationStereo ViT-L sources on a small machine

`{shown("bigpool.py")}`: 12 files of {result["file_bytes"] / 1e9:.2f} GB with random weights,
{opened["values"]:,} values each, of which the sources change {opened["changed"]:,} (the ViT is frozen).
Every step runs in a process of its own; anonymous memory is what only swap could relieve, file pages are
dropped and read again as the system likes. A merge's time is the shortest of seven.

{table(result)}

With 11 sources the most anonymous memory in any step was {most:,.0f} MiB, {verdict} the target of
{TARGET_MB:,} MiB. Loading {plain["sources"]} state dicts and averaging them, the usual way, held
{plain["anonymous_mb"]:,.0f} MiB; it grows by a whole checkpoint a source, and was not run with 11."""
