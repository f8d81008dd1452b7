"""The full report on five real AnyNet checkpoints: one ETH3D pair guides, three other pairs test."""

from __future__ import annotations

import os
from pathlib import Path

from full_report import make, markdown
from sections.quickstart import PAIRS

ROOT = Path(__file__).parents[2]


def section() -> str:
    """Make the report cold and warm, and show its summary and its tables."""
    data = Path(os.environ["SFKIT_REAL_DATA"])
    pairs = [{"name": "pairs", "root": str(data / "pairs" / n), "coding": c} for n, c in PAIRS.items()]
    values = {
        "pool": str(ROOT / "tests" / "pools" / "anynet_real.toml"),
        "benchmark": "eth3d",
        "benchmark_root": str(data / "eth3d"),
        "benchmark_pairs": None,
        "protocol": "raft",
        "report_on": pairs,
        "quick": True,
    }
    done = make(ROOT / "runs" / "results" / "report_real", values)
    cold, warm = done.cold / 60, done.warm / 60
    return f"""## The full report on real AnyNet checkpoints

`sfkit report` with the pool `tests/pools/anynet_real.toml`, guided by one ETH3D pair (playground, `raft`) and
tested on three others under `all-valid`; M = 16, T = 6, 60 evaluations of Stage 2, 5 seeds. It took
{cold:.1f} minutes with nothing in the store and {warm:.1f} minutes again. Each benchmark is one image, so
that no interval exists: read differences with that in mind. What it says first:

{done.summary()}

All methods; `*` marks what guided them, `†` a row that chose by the mean of all:

{markdown(done.table("main", "method"))}

Single sources:

{markdown(done.table("sources", "benchmark"))}

Cosines of the task vectors, by which the pool has fewer directions than sources, and how far each went, in
percent of the base's norm:

{markdown(done.table("cosines", "source"))}

{markdown(done.table("geometry", "block"), digits=1)}

What each method took, each for itself:

{markdown(done.table("cost", "method"), digits=1)}

Stages and scales (seed 0), then the benchmark that guides:

{markdown(done.table("stages", "variant"))}

{markdown(done.table("guides", "fitness"))}"""
