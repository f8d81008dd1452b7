"""Engines: efficiency of added workers, and what an engine costs by itself."""

from __future__ import annotations

from processes import call, shown

COMMAND = ("engines.py", "--json")


def section() -> str:
    """One row an engine, number of workers and amount of work."""
    rows = call(*COMMAND)
    lines = [
        "## Engines: inline, worker processes, Ray",
        "",
        f"`{shown(*COMMAND)}`: subsets of the embedded bank, one thread a worker, scores equal to the last "
        "bit. Efficiency is what each worker achieves of what one does inline; overhead is time in which "
        "no worker computed.",
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
