"""Merging against the speed of memory, beside mergekit."""

from __future__ import annotations

from pictures import bars, picture
from processes import call, shown

DOCUMENT = "benchmarks/README.md"
COMMAND = ("merging.py", "--json")
AIM = 1.15


def section() -> str:
    """One row a variant; ratios at each size and number of threads."""
    found = call(*COMMAND)
    rows = found["rows"]
    cases = list(dict.fromkeys((row["elements"], row["threads"]) for row in rows))
    ratios = {
        name: {
            f"{size / 1e6:.0f} M, {threads} thread{'s' * (threads > 1)}": next(
                row["ratio"]
                for row in rows
                if (row["name"], row["elements"], row["threads"]) == (name, size, threads)
            )
            for size, threads in cases
        }
        for name in dict.fromkeys(row["name"] for row in rows)
    }
    ours = ratios["ours, 11 sources"]
    low, high = min(ours.values()), max(ours.values())
    figure = bars(
        ratios,
        title="How many times the memory limit does a merge take?",
        subtitle=f"11 sources, 400 tensors: ours takes {low:.2f} to {high:.2f} times",
        x="time / (bytes that must move / triad bandwidth)",
    )
    heads = list(ours)
    lines = [
        "| variant | " + " | ".join(heads) + " |",
        "|---|" + "--:|" * len(heads),
        *(f"| {name} | " + " | ".join(f"{row[h]:.2f}" for h in heads) + " |" for name, row in ratios.items()),
    ]
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
            *lines,
            "",
            f"The aim of {AIM} times the limit is {met}.",
        ]
    )
