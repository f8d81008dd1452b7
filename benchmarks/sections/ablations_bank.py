"""The full report's ablations on the embedded bank at its reduced setting."""

from __future__ import annotations

from pathlib import Path

from full_report import make, markdown

ROOT = Path(__file__).parents[2]
SEEDS = 3


def section() -> str:
    """Make the report, and show the tables that change one thing at a time."""
    done = make(ROOT / "runs" / "results" / "ablations_bank", {"quick": True, "seeds": SEEDS})
    return f"""## What the answer on the embedded bank depends on

`sfkit report -p quick true -p seeds {SEEDS} -o report.html`: the pool `bank-sharp` with its 11 sources,
validation on 8 pairs of courtyard, tests on 40 pairs each of three benchmarks; M = 16, T = 6, 60 evaluations
of Stage 2. It took {done.minutes:.0f} minutes with nothing in the store.

As many sources as the search chose, picked by the likeness of their data to each target (the paper's data-set
combinations), against what the search found:

{markdown(done.table("similarity", "network"))}

Stages and scales (seed 0), then the metric and the benchmark that guide:

{markdown(done.table("stages", "variant"))}

{markdown(done.table("metrics", "fitness metric"))}

{markdown(done.table("guides", "fitness"))}

The best subset of Stage 1 by the size of its population, over the seeds:

{markdown(done.table("population", "population"))}"""
