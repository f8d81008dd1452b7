"""The full report on the embedded bank at its reduced setting: every method, every seed, every table."""

from __future__ import annotations

from pathlib import Path

from full_report import make, markdown

ROOT = Path(__file__).parents[2]


def section() -> str:
    """Make the report, and show its summary and its tables."""
    done = make(ROOT / "runs" / "results" / "report_bank", {"quick": True, "seeds": 3})
    return f"""## The full report on the embedded bank

`sfkit report -p quick true -p seeds 3 -o report.html`: 11 sources, validation on 8 pairs of courtyard, tests
on 40 pairs each of three benchmarks; M = 16, T = 6, 60 evaluations of Stage 2, 3 seeds. It took
{done.minutes:.0f} minutes with nothing in the store. What it says first:

{done.summary()}

All methods, tuned on validation alone; `*` marks what guided them, `†` a row that chose by the mean of all:

{markdown(done.table("main", "method"))}

Against the last row on the mean of the unseen, in points; `low` and `high` are the ends of the 95 % interval,
over images and, where a method draws, its seeds:

{markdown(done.table("differences", "method"))}

Single sources:

{markdown(done.table("sources", "benchmark"))}

As many sources as the search chose, picked by the likeness of their data to each target (the paper's data-set
combinations), against what the search found:

{markdown(done.table("similarity", "network"))}

What each method took, each for itself, and beside the fine-tuning of the sources, whose seconds were measured
when the bank was built:

{markdown(done.table("cost", "method"), digits=1)}

{markdown(done.table("overhead", "method"), digits=1)}

Stages and scales (seed 0), then the metric and the benchmark that guide:

{markdown(done.table("stages", "variant"))}

{markdown(done.table("metrics", "fitness metric"))}

{markdown(done.table("guides", "fitness"))}"""
