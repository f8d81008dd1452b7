"""The quickstart on five real AnyNet checkpoints: what ETH3D's one pair finds, on four other pairs."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pandas as pd
from processes import RESULTS, sfkit
from real_pairs import CODINGS, POOL, data
from tabulated import markdown

ROOT = Path(__file__).parents[2]


def measure() -> tuple[pd.DataFrame, float, float]:
    """Run the report command: the table it wrote, its wall seconds and its CPU seconds."""
    # The KITTI 2012 pair, which the sources may have seen in training, and three unseen ones.
    report_on = [{"name": "kitti2012", "root": str(data() / "kitti2012"), "protocol": "all-valid"}]
    for name, coding in CODINGS.items():
        report_on.append({"name": "pairs", "root": str(data() / "pairs" / name), "coding": coding})
    out = RESULTS / "quickstart"
    values = {
        "pool": str(POOL),
        "benchmark": "eth3d",
        "benchmark_root": str(data() / "eth3d"),
        "protocol": "raft",
        "report_on": json.dumps(report_on),
        "report_metrics": json.dumps(["bad-1.0", "bad-2.0", "epe"]),
        "out": str(out),
    }
    words = [word for name, value in values.items() for word in ("-p", name, value)]
    started, worked = time.perf_counter(), children()
    notebook = str(ROOT / "notebooks" / "01_quickstart.ipynb")
    sfkit("report", notebook, *words, "-o", str(out / "report.html"))
    took = time.perf_counter() - started, children() - worked
    return pd.read_csv(out / "scores.csv", index_col="network"), *took


def children() -> float:
    """CPU seconds of the processes that this one started and that have ended, theirs included."""
    return sum(os.times()[2:4])


def section() -> str:
    """The table."""
    scores, seconds, worked = measure()
    return f"""## Quickstart on real AnyNet checkpoints

`sfkit report notebooks/01_quickstart.ipynb` with the pool `tests/pools/anynet_real.toml`, the paper's budgets
(M = 50, T = 15, 300 evaluations) and seed 0, in {seconds:.0f} s ({worked:.0f} s of CPU) with nothing
in the store. Validation is one
ETH3D pair (playground) under protocol `raft`, since its occlusion mask is missing and `openstereo` needs it;
the other pairs are under `all-valid`. The KITTI 2012 pair belongs to the training images of these fine-tunes:
read its columns as "seen in training". `*` marks the columns that guided the search; lower is better.

{markdown(scores)}

One validation pair is little: what Stage 2 gains on it need not show on the other pairs."""
