"""Overhead: what a whole search spends outside the network's forward passes."""

from __future__ import annotations

from typing import Any

from processes import call, shown

DOCUMENT = "benchmarks/README.md"

MODEL = ("--method", "bayesian", "--generations", "41", "--evaluations", "80")
COMMANDS = (
    ("overhead.py", "--json"),
    ("overhead.py", "--bank", "--json"),
    ("overhead.py", *MODEL, "--json"),
)


def section() -> str:
    """One table a network, one row a part of a search."""
    parts = [
        "## Overhead of a search",
        "Both stages on pairs of 256 x 512, as many as the paper validates on. `search` is what no other row "
        "claims: breeding, CMA-ES, ranking, the evaluator's own work. A search by a model of the score is "
        "run whole, since the model's part grows with what it learns from. Errors are counted in a thread of "
        "their own while the network runs, which takes computing and no time. Shares of computing leave out "
        "waiting for the disk.",
    ]
    for command in COMMANDS:
        parts += [f"`{shown(*command)}`: {table(call(*command))}"]
    return "\n\n".join(parts)


def table(found: dict[str, Any]) -> str:
    """What one measurement found."""
    lines = [
        f"{found['network']}, {found['pairs']} pairs, {found['method']} method, {found['evaluations']} "
        f"evaluations in {found['seconds']:.0f} s, of which **{100 * found['outside']:.1f} %** lie outside "
        f"the network's forward passes ({100 * found['outside_computing']:.1f} % of computing). Pool and "
        f"images were made ready before, once, in {found['before']:.1f} s.",
        "",
        "| part | share, % | of computing, % | ms an evaluation | calls |",
        "|---|--:|--:|--:|--:|",
    ]
    for r in found["rows"]:
        each = 1e3 * r["seconds"] / found["evaluations"]
        shares = f"{100 * r['share']:.2f} | {100 * r['computing']:.2f}"
        lines.append(f"| {r['part']} | {shares} | {each:.2f} | {r['calls']:,} |")
    return "\n".join(lines)
