"""Memory and time of pools as large as real ones: opening, merging, writing, against plain averaging.

    python benchmarks/bigpool.py                    # FoundationStereo ViT-L, 3 and 11 sources: 18 GB of files
    python benchmarks/bigpool.py nmrf-swint --json  # NMRF Swin-T, 11 sources, with an evaluation
    python benchmarks/bigpool.py quick              # a small network, to see that it works

Weights are random. Files go to a folder outside the checkout and are removed at the end. Every step runs
in a process of its own, so that peaks are its own; memory is anonymous pages, file pages stand apart. The
first opening finds neither cached task vectors nor file pages in memory; ``read files`` is what the disk
needs to hand over the same files. A step's peak includes Python and torch, about 300 MiB.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from processes import answered, call_watched, machine, shown
from synthetic_pool import PoolShape, describe, file_size, forget_pages, temporary_folder, write_checkpoints
from tabulated import markdown_lines

DOCUMENT = "benchmarks/README.md"

TARGET_MB = 6 * 1024  # anonymous memory with 11 sources of ViT-L
VIT_L = PoolShape("foundation-stereo", sources=11, options={"vit_size": "vitl"}, frozen="feature.dino.")
NMRF = PoolShape("nmrf-swint", sources=11)
STEPS = ("merge", "write")
Plan = tuple[PoolShape, tuple[int, ...], int, tuple[str, ...]]
PLANS: Mapping[str, Plan] = {
    "vitl": (VIT_L, (3, 11), 3, STEPS),
    "nmrf-swint": (NMRF, (11,), 11, (*STEPS, "evaluate")),
    "quick": (PoolShape("nmrf-res", sources=2, frozen="backbone."), (2,), 2, STEPS),
}
"""The pool; numbers of sources, one round of steps each; how many the copying baseline loads; what follows
the two openings, in order."""


def measure(
    plan: Literal["vitl", "nmrf-swint", "quick"] = "vitl", folder: Path | None = None
) -> dict[str, Any]:
    """Write the pool, run every step, remove the pool.

    Args:
        plan: what to measure.
        folder: where the files go for that time; the system's temporary folder by default.

    Returns:
        ``machine``; ``file_bytes``; ``rows``, one a step: ``sources``, ``step``, its seconds,
        ``anonymous_mb`` and ``mapped_mb`` (peaks, MiB).
    """
    shape, counts, averaged, steps = PLANS[plan]
    size = file_size(shape)
    needed = size * (shape.sources + 2 + max(counts))  # files, a merged one, task vectors
    rows = []
    with temporary_folder(folder, needed) as place:
        print(f"writing {shape.sources + 1} files of {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
        write_checkpoints(place, shape)
        for count in counts:
            os.environ["SFKIT_CACHE"] = str(place / f"cache{count}")  # of the steps' processes: starts empty
            pool = describe(place, shape, count)
            for step, label in (("read", "read files"), ("open", "open first")):
                forget_pages(place)
                rows.append(_step(step, pool, count, label))
            rows.append(_step("open", pool, count, "open again"))
            rows += [_step(step, pool, count, step) for step in steps]
        rows.append(_step("average", describe(place, shape, averaged), averaged, "average"))
    return {"machine": machine(), "file_bytes": size, "rows": rows}


def _step(step: str, pool: Path, count: int, label: str) -> dict[str, Any]:
    figures, peak = call_watched("pool_steps.py", step, str(pool))
    row = {"sources": count, "step": label, **figures, **vars(peak)}
    print(*_cells(row), "MiB", sep="  ", file=sys.stderr, flush=True)
    return row


def table(result: Mapping[str, Any]) -> str:
    """The figures as a Markdown table."""
    heads = ("sources", "step", "seconds", "anonymous MiB", "file pages MiB")
    return markdown_lines(heads, map(_cells, result["rows"]), [True, False, False, True, True])


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Seconds as ``"equal 0.123, routed 0.125"``."""
    named = {key.removesuffix("_seconds"): value for key, value in row.items() if key.endswith("_seconds")}
    seconds = ", ".join(f"{name} {value:.3f}" for name, value in named.items())
    memory = (f"{row[key]:,.0f}" for key in ("anonymous_mb", "mapped_mb"))
    return str(row["sources"]), row["step"], seconds, *memory


def section() -> str:
    """The table, and whether the target for anonymous memory was met."""
    result = measure("vitl")
    rows = result["rows"]
    most = max(row["anonymous_mb"] for row in rows if row["sources"] == 11)
    (plain,) = (row for row in rows if row["step"] == "average")
    opened = next(row for row in rows if row["step"] == "open first")
    return f"""## Eleven FoundationStereo ViT-L sources on a small machine

`{shown("bigpool.py")}`: 12 files of {result["file_bytes"] / 1e9:.2f} GB with random weights,
{opened["values"]:,} values each, of which the sources change {opened["changed"]:,} (the ViT is frozen).
Every step runs in a process of its own; anonymous memory is what only swap could relieve, file pages are
dropped and read again as the system likes. A merge's time is the shortest of seven.

{table(result)}

With 11 sources the most anonymous memory in any step was {most:,.0f} MiB, \
{"under" if most < TARGET_MB else "above"} the target of
{TARGET_MB:,} MiB. Loading {plain["sources"]} state dicts and averaging them, the usual way, held
{plain["anonymous_mb"]:,.0f} MiB; it grows by a whole checkpoint a source, and was not run with 11."""


if __name__ == "__main__":
    answered(measure, table)
