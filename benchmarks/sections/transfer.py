"""A subset carried to another architecture, and a pool that gains a source, on the two first banks."""

from __future__ import annotations

import pandas as pd
from processes import RESULTS, sfkit
from tabulated import markdown


def section() -> str:
    """Run the notebook with the paper's budgets and show both tables."""
    moved, grown = tables("transfer", pool="bank", second_pool="bank-slim")
    return f"""## Subset transfer and a growing pool

`sfkit report 08_transfer_and_growth -p pool bank -p second_pool bank-slim`: the paper's budgets (M = 50,
T = 15, 300 evaluations), seed 0, validation on 8 pairs of courtyard. `bank-slim` is the second
architecture, an AnyNet with narrower 3-D convolutions trained on the same domains. Each pool once with
its own search and once with the other's subset:

{moved}

`scanned-street` joins the pool `bank` last; Stage 1 before it, and after it twice:

{grown}"""


def tables(name: str, **values: object) -> tuple[str, str]:
    """Run the notebook with these parameters: subsets carried over, and the pool that grows.

    Run again it goes on from the store it left behind.
    """
    out = RESULTS / name
    given = [word for key, value in values.items() for word in ("-p", key, str(value))]
    sfkit("report", "08_transfer_and_growth", *given, "-p", "out", str(out), "-o", str(out / "report.html"))
    moved = pd.read_csv(out / "tables" / "transfer.csv")
    moved.index = pd.Index(moved["pool"] + ", " + moved["subset from"], name="pool, subset from")
    grown = pd.read_csv(out / "tables" / "growth.csv", index_col="search").T
    return markdown(moved.drop(columns=["pool", "subset from"]).fillna("")), markdown(
        grown.rename_axis("what")
    )
