"""Memory and time of pools as large as real ones: opening, merging, writing, against plain averaging.

    python benchmarks/bigpool.py                    # FoundationStereo ViT-L, 3 and 11 sources: 18 GB of files
    python benchmarks/bigpool.py nmrf-swint --json  # NMRF Swin-T, 11 sources, with an evaluation
    python benchmarks/bigpool.py --quick            # a small network, to see that it works

Weights are random. Files go to a folder outside the checkout and are removed at the end. Every step runs
in a process of its own, so that peaks are its own; memory is anonymous pages, file pages stand apart. The
first opening finds neither cached task vectors nor file pages in memory; ``read files`` is what the disk
needs to hand over the same files. A step's peak includes Python and torch, about 300 MiB.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import call_watched, machine, shown
from synthetic_pool import PoolShape, describe, file_size, forget_pages, temporary_folder, write_checkpoints

DOCUMENT = "benchmarks/README.md"

TARGET_MB = 6 * 1024  # anonymous memory with 11 sources of ViT-L


@dataclass(frozen=True)
class PoolSteps:
    """A pool, and what is measured on it.

    Attributes:
        shape: the pool.
        counts: numbers of sources, one round of steps each.
        averaged: the number of sources that the copying baseline loads.
        steps: after the two openings, in order.
    """

    shape: PoolShape
    counts: tuple[int, ...]
    averaged: int
    steps: tuple[str, ...] = ("merge", "write")


PLANS: Mapping[str, PoolSteps] = {
    "vitl": PoolSteps(
        PoolShape(
            "foundation-stereo",
            sources=11,
            options={"vit_size": "vitl"},
            frozen="feature.dino.",
            published="foundationstereo/foundationstereo_vitl_keys.json",
        ),
        counts=(3, 11),
        averaged=3,
    ),
    "nmrf-swint": PoolSteps(
        PoolShape("nmrf-swint", sources=11, published="nmrf/nmrf_swint_keys.json"),
        counts=(11,),
        averaged=11,
        steps=("merge", "write", "evaluate"),
    ),
    "quick": PoolSteps(PoolShape("nmrf-res", sources=2, frozen="backbone."), counts=(2,), averaged=2),
}


def measure(plan: PoolSteps, folder: Path | None = None) -> dict[str, Any]:
    """Write the pool, run every step, remove the pool.

    Args:
        plan: what to measure.
        folder: where the files go for that time; the system's temporary folder by default.

    Returns:
        ``machine``; ``file_bytes``; ``rows``, one a step: ``sources``, ``step``, its seconds,
        ``anonymous_mb`` and ``mapped_mb`` (peaks, MiB).
    """
    size = file_size(plan.shape)
    needed = size * (plan.shape.sources + 2) + size * max(plan.counts)  # files, a merged one, task vectors
    with temporary_folder(folder, needed) as place:
        _say(f"writing {plan.shape.sources + 1} files of {size / 1e6:.0f} MB")
        write_checkpoints(place, plan.shape)
        rows = [row for count in plan.counts for row in _round(place, plan, count)]
        rows.append(_step("average", describe(place, plan.shape, plan.averaged), plan.averaged))
    return {"machine": machine(), "file_bytes": size, "rows": rows}


def _round(place: Path, plan: PoolSteps, count: int) -> list[dict[str, Any]]:
    """All steps on the first ``count`` sources, with a cache of task vectors that starts empty."""
    os.environ["SFKIT_CACHE"] = str(place / f"cache{count}")  # of the steps' processes
    pool = describe(place, plan.shape, count)
    rows = []
    for step, label in (("read", "read files"), ("open", "open first")):
        forget_pages(place)
        rows.append(_step(step, pool, count, label))
    rows.append(_step("open", pool, count, "open again"))
    return [*rows, *(_step(step, pool, count) for step in plan.steps)]


def _step(step: str, pool: Path, count: int, label: str | None = None) -> dict[str, Any]:
    figures, peak = call_watched("pool_steps.py", step, str(pool))
    row = {"sources": count, "step": label or step, **figures, **vars(peak)}
    _say(f"{count:3} sources, {row['step']}: {_seconds(row)}, {peak.anonymous_mb:.0f} MiB anonymous")
    return row


def table(result: Mapping[str, Any]) -> str:
    """The figures as a Markdown table."""
    lines = ["| sources | step | seconds | anonymous MiB | file pages MiB |", "|--:|---|---|--:|--:|"]
    lines += [
        f"| {row['sources']} | {row['step']} | {_seconds(row)} | {row['anonymous_mb']:,.0f} "
        f"| {row['mapped_mb']:,.0f} |"
        for row in result["rows"]
    ]
    return "\n".join(lines)


def _seconds(row: Mapping[str, Any]) -> str:
    """``"equal 0.123, routed 0.125"`` from a row's seconds."""
    named = {key.removesuffix("_seconds"): value for key, value in row.items() if key.endswith("_seconds")}
    return ", ".join(f"{name} {value:.3f}" for name, value in named.items())


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "plan", nargs="?", default="vitl", choices=[name for name in PLANS if name != "quick"]
    )
    parser.add_argument("--quick", action="store_true", help="a small network")
    parser.add_argument("--folder", type=Path, help="where the files go, outside the checkout")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    result = measure(PLANS["quick" if options.quick else options.plan], options.folder)
    print(json.dumps(result) if options.json else table(result))


def section() -> str:
    """The table, and whether the target for anonymous memory was met."""
    result = measure(PLANS["vitl"])
    rows = result["rows"]
    most = max(row["anonymous_mb"] for row in rows if row["sources"] == 11)
    plain = next(row for row in rows if row["step"] == "average")
    opened = next(row for row in rows if row["step"] == "open first")
    verdict = "under" if most < TARGET_MB else "above"
    return f"""## Eleven FoundationStereo ViT-L sources on a small machine

`{shown("bigpool.py")}`: 12 files of {result["file_bytes"] / 1e9:.2f} GB with random weights,
{opened["values"]:,} values each, of which the sources change {opened["changed"]:,} (the ViT is frozen).
Every step runs in a process of its own; anonymous memory is what only swap could relieve, file pages are
dropped and read again as the system likes. A merge's time is the shortest of seven.

{table(result)}

With 11 sources the most anonymous memory in any step was {most:,.0f} MiB, {verdict} the target of
{TARGET_MB:,} MiB. Loading {plain["sources"]} state dicts and averaging them, the usual way, held
{plain["anonymous_mb"]:,.0f} MiB; it grows by a whole checkpoint a source, and was not run with 11."""


if __name__ == "__main__":
    main()
