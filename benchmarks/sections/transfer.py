"""A subset carried to another architecture, and a pool that gains a source, on the two embedded banks."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from processes import sfkit
from tabulated import markdown

ROOT = Path(__file__).parents[2]


def section() -> str:
    """Run the notebook with the paper's budgets and show both tables."""
    out = ROOT / "runs" / "results" / "transfer"
    sfkit("report", "08_transfer_and_growth", "-p", "out", str(out), "-o", str(out / "report.html"))
    moved = pd.read_csv(out / "tables" / "transfer.csv")
    moved.index = pd.Index(moved["pool"] + ", " + moved["subset from"], name="pool, subset from")
    grown = pd.read_csv(out / "tables" / "growth.csv", index_col="search").T
    return f"""## Subset transfer and a growing pool

`sfkit report 08_transfer_and_growth -o report.html`: the paper's budgets (M = 50, T = 15, 300 evaluations),
seed 0, validation on 8 pairs of courtyard. `bank-slim` is the second architecture, an AnyNet with
narrower 3-D convolutions trained on the same domains. Each pool once with
its own search and once with the other's subset:

{markdown(moved.drop(columns=["pool", "subset from"]).fillna(""))}

`scanned-street` joins the pool `bank` last; Stage 1 before it, and after it twice:

{markdown(grown.rename_axis("what"))}"""
