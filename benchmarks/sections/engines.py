"""Engines: efficiency of added workers, and what an engine costs by itself."""

from __future__ import annotations

import os

from pictures import bars, picture
from processes import call, shown

DOCUMENT = "benchmarks/README.md"

COMMAND = ("engines.py", "--json")


def section() -> str:
    """One row an engine, number of workers and amount of work."""
    rows = call(*COMMAND)
    most, few = sorted({r["evaluations"] for r in rows}, reverse=True)
    values: dict[str, dict[str, float]] = {}
    for r in rows:
        label = f"{r['engine']}, {r['workers']} worker{'s' * (r['workers'] > 1)}"
        values.setdefault(label, {})[f"{r['evaluations']} evaluations"] = r["efficiency"]
    figure = bars(
        values,
        title="How much of every worker is gained?",
        subtitle=f"efficiency against inline, {most} and {few} evaluations, on {os.cpu_count()} cores",
        x="efficiency (1 is a whole inline worker each)",
    )
    lines = [
        "## Engines: inline, worker processes, Ray",
        "",
        f"`{shown(*COMMAND)}`: subsets of the embedded bank, one thread a worker, scores equal to the last "
        "bit. Efficiency is what each worker achieves of what one does inline; overhead is time in which "
        "no worker computed.",
        "",
        picture(figure, "engines", "Efficiency of engines by number of workers"),
        "",
        "| engine | workers | evaluations | start, s | all, s | of inline | efficiency | overhead, ms each |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for r in rows:
        lines.append(
            f"| {r['engine']} | {r['workers']} | {r['evaluations']} | {r['start']:.1f} | {r['seconds']:.2f} "
            f"| {r['of_inline']:.2f} | {r['efficiency']:.2f} | {r['overhead_ms']:.1f} |"
        )
    return "\n".join(lines)
