"""The demo on the embedded bank, from an empty store."""

from __future__ import annotations

import json
import shutil
from typing import Any

import pandas as pd
from processes import RESULTS, sfkit
from tabulated import markdown

from sfkit.bank.demo import TEST_PAIRS

OUT = RESULTS / "demo"


def measure() -> dict[str, Any]:
    """What ``sfkit demo`` prints."""
    shutil.rmtree(OUT, ignore_errors=True)
    found: dict[str, Any] = json.loads(sfkit("demo", "--json", "-o", str(OUT)))
    return found


def section() -> str:
    """Its table."""
    found = measure()
    table = pd.DataFrame.from_dict(found["table"], orient="index")
    return f"""## Demo on the embedded bank

`sfkit demo` from an empty store: {found["evaluations"]} evaluations,
{found["forward_passes"]:,} forward passes, {found["seconds"]:.0f} s with its report. Stage 1 chose
{", ".join(found["subset"])}. `*` marks the column that guided the search (its first 8 pairs); the other
benchmarks have {TEST_PAIRS} unseen pairs each. Lower is better.

{markdown(table)}"""
