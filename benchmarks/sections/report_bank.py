"""The full report on the embedded bank, on small budgets: every method, every seed, every table."""

from __future__ import annotations

from pathlib import Path

from full_report import make, markdown

from sfkit.bank import VALIDATION, benchmarks

ROOT = Path(__file__).parents[2]
POOL = "bank-sharp"
TESTS = 16
WORLDS = [f"{POOL}:{name}" for name in benchmarks() if name != VALIDATION]
PARAMETERS: dict[str, object] = {
    "pool": POOL,
    "population": 10,
    "generations": 4,
    "evaluations": 30,
    "seeds": 2,
    "report_on": [{"name": name, "pairs": TESTS} for name in WORLDS],
}
GIVEN = ", ".join(f"`-p {name} {value}`" for name, value in PARAMETERS.items() if isinstance(value, int))


def section() -> str:
    """Make the report, and show its summary and its tables."""
    done = make(ROOT / "runs" / "results" / "report_bank", PARAMETERS)
    return f"""## The full report on the embedded bank

`sfkit report` on `{POOL}` with {GIVEN}:
11 sources, validation on 8 pairs of courtyard, tests on {TESTS} pairs each of three benchmarks. It took
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

{markdown(done.table("guides", "fitness"))}

The best subset of Stage 1 by the size of its population, over the seeds:

{markdown(done.table("population", "population"))}"""
