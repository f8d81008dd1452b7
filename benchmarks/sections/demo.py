"""The demo on the embedded bank, from an empty store: its table, its time and its memory."""

from __future__ import annotations

import json
import shutil
import sys
from typing import Any

import pandas as pd
from processes import RESULTS, Whole, watched
from tabulated import markdown

from sfkit.bank.demo import TEST_PAIRS
from sfkit.bank.plan import MAIN

OUT = RESULTS / "demo"


def measure() -> tuple[dict[str, Any], Whole]:
    """What ``sfkit demo`` prints, and what the command took with the notebook's process that it starts."""
    shutil.rmtree(OUT, ignore_errors=True)
    printed, took = watched(sys.executable, "-m", "sfkit", "demo", "--json", "-o", str(OUT))
    found: dict[str, Any] = json.loads(printed)
    return found, took


def section() -> str:
    """Its table."""
    found, took = measure()
    table = pd.DataFrame.from_dict(found["table"], orient="index")
    held = f"{took.resident_mb / 1024:.2f} GiB of memory"
    return f"""## Demo on the embedded bank

`sfkit demo` on `{MAIN.name}` from an empty store: {found["evaluations"]} evaluations,
{found["forward_passes"]:,} forward passes, {found["seconds"]:.0f} s with its report
({found["cpu_seconds"]:.0f} s of CPU, all its processes together), {took.seconds:.0f} s
from the command's start to its end. Its processes, at most {took.processes} at once, held at most
{held} together, pages that they share counted in each. Stage 1 chose
{", ".join(found["subset"])}. `*` marks the column that guided the search (its first 8 pairs); the other
benchmarks have {TEST_PAIRS} unseen pairs each. Lower is better.

{markdown(table)}"""
