"""A subset carried from the sharp bank to the first one and back, and the sharp bank that gains a source."""

from __future__ import annotations

import json

from sections.report_bank import worlds
from sections.transfer import tables

POOLS = {"pool": "bank-sharp", "second_pool": "bank"}
GUIDES, TESTS = 5, 8
BUDGETS = {"population": 16, "generations": 6, "evaluations": 40}


def section() -> str:
    """Run the notebook as it opens, with smaller budgets than its own, and show both tables."""
    tests = json.dumps([{"name": name, "pairs": TESTS} for name in worlds()])
    moved, grown = tables(
        "transfer-bank-sharp", engine="inline", benchmark_pairs=GUIDES, report_on=tests, **POOLS, **BUDGETS
    )
    return f"""## Subset transfer and a growing pool: the sharp bank

`sfkit report 08_transfer_and_growth` on the pools it opens, `bank-sharp` and, as the second architecture, the
first bank, whose domains have the same names and of which six are milder. {GUIDES} pairs of courtyard guide,
{TESTS} pairs each of three other worlds test; M = {BUDGETS["population"]}, T = {BUDGETS["generations"]}, \
{BUDGETS["evaluations"]} evaluations of Stage 2, seed 0:

{moved}

`scanned-street` joins the pool `bank-sharp` last:

{grown}"""
