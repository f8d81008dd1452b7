"""Searches on the table of all subsets of the bank: evaluations until the best one."""

from __future__ import annotations

import pandas as pd
from bayesian import GROWN
from optimum import LANDSCAPES, kept

from sfkit.analysis.tables import markdown_lines

DOCUMENT = "benchmarks/README.md"
HEAD = """## Evaluations until the best of all subsets

`python benchmarks/optimum.py` runs the searches and goes on where it was. On the scores of all subsets of
the bank's sources; only distinct evaluations cost, sources scored alone as well, which win nothing. "Never"
stands for a median or a most of searches that ended without it; CPU is what the search itself takes an
evaluation. Rows with fewer seeds are those whose searches cost more, or that have not run further yet."""
BATCHES = """### Batches of the model's proposals

One worker for each proposal of a batch, simulated: evaluations of one length but for a spread of 5 %, a batch
begins when the one before has ended. Time is in evaluations; speed-up and losses are against one at a time.
A batch hears the model's own mean for those before (kriging believer)."""
GROWTH = """### A pool that gains a source

Every source of the best subset is the newcomer in turn: the pool without it is searched to the end, then the
whole pool. New evaluations are those that were not in the store."""


def section() -> str:
    """Tables of whatever ``benchmarks/optimum.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    if not any(kept.folder.glob("*.csv")):
        raise SystemExit("nothing is finished yet: run python benchmarks/optimum.py first")
    parts = [HEAD]
    for text, table in (("", searches), (BATCHES, batches), (GROWTH, growth)):
        tables = [(pairs, table(pairs)) for pairs in LANDSCAPES]
        made = [f"On the first {pairs} validation pairs:\n\n{found}" for pairs, found in tables if found]
        parts += [part for part in (text, *made) if part] if made else []
    return "\n\n".join(parts)


def searches(pairs: int) -> str:
    """A row a search; nothing where none is finished."""
    frame = kept.results(f"search-{pairs:02d}-")
    if frame.empty:
        return ""
    rows = [
        (name, len(part), *share_within(part["needed"]), f"{1000 * part['seconds'].mean():.1f}")
        for name, part in sorted(frame.groupby("search"), key=lambda item: item[1]["needed"].median())
    ]
    heads = ("search", "seeds", "found it", "median", "most", "within 60", "within 90", "CPU, ms")
    return markdown_lines(heads, rows)


def share_within(needed: pd.Series) -> tuple[str, ...]:
    """Share of seeds that found it, median, most, and shares within 60 and 90 evaluations."""
    shares = [(needed < float("inf")).mean(), (needed <= 60).mean(), (needed <= 90).mean()]
    found, sixty, ninety = (f"{100 * share:.0f} %" for share in shares)
    return found, number(needed.median()), number(needed.max()), sixty, ninety


def number(value: float) -> str:
    """A count; one that is infinite was never reached."""
    return "never" if value == float("inf") else f"{value:.0f}"


def batches(pairs: int) -> str:
    """A row a size of batch; nothing where none is finished."""
    frame = kept.results(f"batch-{pairs:02d}-")
    if frame.empty or 1 not in set(frame["batch"]):
        return ""
    one = frame[frame["batch"] == 1]
    rows = []
    for batch, part in frame.groupby("batch"):
        found, median, most, sixty, ninety = share_within(part["needed"])
        lost = part["needed"].median() - one["needed"].median()
        gained = one["wall"].median() / part["wall"].median()
        share = f"{100 * gained / batch:.0f} %"
        busy = f"{100 * part['busy'].mean():.0f} %"
        cost = f"{1000 * part['seconds'].mean():.1f}"
        rows.append(
            (
                batch,
                len(part),
                found,
                median,
                most,
                sixty,
                ninety,
                number(lost),
                number(part["rounds"].median()),
                f"{part['wall'].median():.1f}",
                f"{gained:.1f}",
                share,
                busy,
                cost,
            )
        )
    heads = (
        "batch",
        "seeds",
        "found it",
        "median",
        "most",
        "within 60",
        "within 90",
        "lost to batching",
        "rounds",
        "time",
        "speed-up",
        "efficiency",
        "workers busy",
        "CPU, ms",
    )
    return markdown_lines(heads, rows)


def growth(pairs: int) -> str:
    """A row a way; nothing where none is finished."""
    frame = kept.results(f"grown-{pairs:02d}-")
    if frame.empty:
        return ""
    rows = []
    for way in GROWN:
        part = frame[frame["way"] == way]
        found, median, most, *_ = share_within(part["needed"])
        rows.append((way, len(part), found, median, most))
    heads = ("search of the grown pool", "searches", "found it", "median new evaluations", "most")
    return markdown_lines(heads, rows)
