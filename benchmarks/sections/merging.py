"""Merging against the speed of memory, beside mergekit."""

from __future__ import annotations

from typing import Any

from pictures import bars, picture
from processes import call, shown

from sfkit.analysis.tables import markdown_lines

DOCUMENT = "benchmarks/README.md"
COMMAND = ("merging.py", "--json")
AIM = 1.15


def section() -> str:
    """One row a variant; ratios at each size and number of threads."""
    found = call(*COMMAND)
    ties = [row for row in found["rows"] if "ties" in row["name"].lower()]
    rows = [row for row in found["rows"] if row not in ties]
    ratios = _by_case(rows, "ratio")
    milliseconds = _by_case(rows, "milliseconds")
    ours = ratios["ours, 11 sources"]
    low, high = min(ours.values()), max(ours.values())
    figure = bars(
        ratios,
        title="How many times the memory limit does a merge take?",
        subtitle=f"11 sources, 400 tensors: ours takes {low:.2f} to {high:.2f} times",
        x="time / (bytes that must move / triad bandwidth)",
    )
    bandwidths = "; ".join(
        f"{b['threads']} thread{'s' * (b['threads'] > 1)}: copy {b['copy'] / 1e9:.1f} GB/s, "
        f"triad {b['triad'] / 1e9:.1f} GB/s"
        for b in found["bandwidth"]
    )
    met = "met" if high <= AIM else "not met"
    return "\n".join(
        [
            "## Merging at the speed of memory",
            "",
            f"`{shown(*COMMAND)}`: float32, 400 tensors in 12 blocks, 11 sources; time as a multiple of the "
            "limit, the bytes that must move over the triad bandwidth of the same run on arrays larger than "
            f"the last cache. {bandwidths}. Every result is checked, and that parameters are views of the "
            "merged buffer.",
            "",
            picture(figure, "merging", "Time of merges as multiples of the memory limit"),
            "",
            _table(ratios),
            "",
            f"The aim of {AIM} times the limit is {met}. {_beside(milliseconds)}",
            "",
            "TIES at 50 M elements, against the limit of a linear merge (aims: 15 for one lambda, 2 for each "
            "further one):",
            "",
            _table(_by_case(ties, "ratio")),
        ]
    )


Cases = dict[str, dict[str, float]]
"""Variant -> size and threads -> figure."""


def _by_case(rows: list[dict[str, Any]], figure: str) -> Cases:
    found: Cases = {}
    for row in rows:
        threads = f"{row['threads']} thread{'s' * (row['threads'] > 1)}"
        found.setdefault(row["name"], {})[f"{row['elements'] / 1e6:.0f} M, {threads}"] = row[figure]
    return found


def _table(figures: Cases) -> str:
    heads = list(next(iter(figures.values())))
    rows = [(name, *(f"{row[h]:.2f}" for h in heads)) for name, row in figures.items()]
    return markdown_lines(("variant", *heads), rows, [False, *[True] * len(heads)])


def _beside(milliseconds: Cases) -> str:
    """How many times faster than mergekit, where that was measured."""
    ours, sentences = milliseconds["ours, 11 sources"], []
    for name, aim in (("mergekit linear", 2.5), ("mergekit task_arithmetic", 5.0)):
        if name in milliseconds:
            times = [theirs / ours[case] for case, theirs in milliseconds[name].items()]
            sentences.append(f"{name} takes {min(times):.1f} to {max(times):.1f} times as long (aim {aim}).")
    return " ".join(sentences)
