"""A subset carried from the sharp bank to the first one and back, and the sharp bank that gains a source."""

from __future__ import annotations

from sections.transfer import tables

POOLS = {"pool": "bank-sharp", "second_pool": "bank"}
BUDGETS = {"population": 20, "generations": 8, "evaluations": 80}


def section() -> str:
    """Run the notebook as it opens, with smaller budgets than its own, and show both tables."""
    moved, grown = tables("transfer-bank-sharp", engine="inline", **POOLS, **BUDGETS)
    return f"""## Subset transfer and a growing pool: the sharp bank

`sfkit report 08_transfer_and_growth` on the pools it opens, `bank-sharp` and, as the second architecture, the
first bank, whose domains have the same names and of which six are milder: M = {BUDGETS["population"]},
T = {BUDGETS["generations"]}, {BUDGETS["evaluations"]} evaluations of Stage 2, seed 0,
8 pairs of courtyard guide.

{moved}

`scanned-street` joins the pool `bank-sharp` last:

{grown}"""
