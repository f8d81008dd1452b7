"""Overhead: what a whole search spends outside the network's forward passes."""

from __future__ import annotations

from processes import call, shown

DOCUMENT = "benchmarks/README.md"

COMMAND = ("overhead.py", "--json")


def section() -> str:
    """One row a part of a search."""
    found = call(*COMMAND)
    lines = [
        "## Overhead of a search",
        "",
        f"`{shown(*COMMAND)}`: both stages at the paper's budgets on the embedded bank's AnyNet, "
        f"{found['pairs']} pairs of 256 x 512, {found['evaluations']} evaluations in {found['seconds']:.0f} "
        f"s, of which **{100 * found['outside']:.1f} %** lie outside the network's forward passes "
        f"({100 * found['outside_computing']:.1f} % of computing, without waiting for the disk). The pool "
        f"was opened and the images were prepared before, once, in {found['before']:.1f} s.",
        "",
        "| part | share, % | of computing, % | ms an evaluation | calls |",
        "|---|--:|--:|--:|--:|",
    ]
    for r in found["rows"]:
        each = 1e3 * r["seconds"] / found["evaluations"]
        shares = f"{100 * r['share']:.2f} | {100 * r['computing']:.2f}"
        lines.append(f"| {r['part']} | {shares} | {each:.2f} | {r['calls']:,} |")
    return "\n".join(lines)
