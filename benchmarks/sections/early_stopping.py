"""Early stopping: the share of image passes that exact bounds could leave out of Stage 1."""

from __future__ import annotations

import statistics

from processes import call, shown

DOCUMENT = "benchmarks/README.md"

COMMAND = ("early_stopping.py", "--json")
POLICIES = ("survivors", "survivors, hard first", "lazy", "lazy, hard first")


def section() -> str:
    """One row a seed, a column a policy."""
    rows = call(*COMMAND)
    lines = [
        "## What early stopping would save",
        "",
        f"`{shown(*COMMAND)}`: Stage 1 at the paper's settings on the embedded bank. Every policy, replayed, "
        "goes the search's own way; shares are of image passes it need not make. `lazy` with hard images "
        "first is the least an exact method of this kind can do: candidates of one population score too much "
        "alike for a part of the images to prove that one loses. Searches therefore evaluate every candidate "
        "on all images.",
        "",
        f"| seed | subsets | image passes | {' | '.join(POLICIES)} |",
        f"|--:|--:|--:|{'--:|' * len(POLICIES)}",
    ]
    for r in rows:
        shares = " | ".join(f"{100 * r[policy]:.1f} %" for policy in POLICIES)
        lines.append(f"| {r['seed']} | {r['subsets']} | {r['passes']:,} | {shares} |")
    means = " | ".join(f"{100 * statistics.fmean(r[policy] for r in rows):.1f} %" for policy in POLICIES)
    lines.append(f"| mean | | | {means} |")
    return "\n".join(lines)
