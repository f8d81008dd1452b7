"""How soon an edit in the RoutingInspector shows."""

from __future__ import annotations

from inspector_latency import measure, table
from processes import shown

DOCUMENT = "benchmarks/README.md"

TARGET = 150.0  # ms, the median first picture on the embedded bank


def section() -> str:
    """The table, and whether the target was met."""
    records = measure()
    bank = records[0]
    verdict = "under" if bank.first_median < TARGET else "above"
    return f"""## From an edit in the RoutingInspector to changed pixels

`{shown("inspector_latency.py")}`: {bank.edits} edits of a routing weight by a key in JupyterLab, in headless
Chromium beside its kernel on the same cores; from the browser's time stamp of the key to the second frame
after the disparity picture was exchanged. Where the network is slow the first picture is at reduced size.

{table(records)}

The embedded bank's median is {bank.first_median:.0f} ms, {verdict} the target of {TARGET:.0f} ms."""
