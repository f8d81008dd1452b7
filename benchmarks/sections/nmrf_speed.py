"""NMRF on the CPU, beside the original code's figures."""

from __future__ import annotations

import importlib

from processes import call, shown

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """One row a variant at 384 x 1248."""
    original = importlib.import_module("nmrf_speed").ORIGINAL
    lines = [
        "## NMRF, one disparity map of 384 x 1248 on the CPU",
        "",
        f"`{shown('nmrf_speed.py', 'VARIANT', '--threads', '2')}`; the original code's figures are of its "
        "specification, measured with two threads on another, busy machine. CPU seconds count both threads.",
        "",
        "| variant | wall s | CPU s | peak MB | original: wall s | CPU s | peak MB |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, (wall, cpu, memory) in original.items():
        r = call("nmrf_speed.py", name, "--threads", "2", "--json")
        lines.append(
            f"| {name} | {r['wall_ms'] / 1000:.1f} | {r['cpu_seconds']:.1f} | {r['peak_memory_mb']:,} "
            f"| {wall / 1000:.1f} | {cpu:.1f} | {memory:,} |"
        )
    return "\n".join(lines)
