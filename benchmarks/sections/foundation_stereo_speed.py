"""FoundationStereo on the CPU, beside the reference's figures where the specification has some."""

from __future__ import annotations

from processes import call, shown

DOCUMENT = "benchmarks/README.md"

SCRIPT = "foundation_stereo_speed.py"
SMALL = ("--height", "128", "--width", "256", "--max-disp", "192", "--iterations", "4")
CASES = (
    (("--vit-size", "vits", *SMALL), "12 s, 1.3 GB"),
    (("--vit-size", "vitl", *SMALL), "15 to 55 s, 3.7 GB"),
    (("--vit-size", "vits", "--height", "480", "--width", "640", "--iterations", "4"), ""),
    (("--vit-size", "vits", "--height", "480", "--width", "640", "--iterations", "4", "--low-memory"), ""),
)


def section() -> str:
    """One row a case."""
    lines = [
        "## FoundationStereo, one disparity map on the CPU",
        "",
        f"`{shown(SCRIPT, 'ARGUMENTS')}` with random weights; a run of 32 iterations adds 28 updates. The "
        "reference's figures are of its specification, measured on another, busy machine.",
        "",
        "| arguments | wall s | CPU s | of it before the updates | an update | peak MB | reference |",
        "|---|--:|--:|--:|--:|--:|---|",
    ]
    for arguments, reference in CASES:
        r = call(SCRIPT, *arguments, "--json")
        lines.append(
            f"| `{' '.join(arguments)}` | {r['wall_seconds']:.1f} | {r['cpu_seconds']:.1f} "
            f"| {r['cpu_seconds_before_updates']:.1f} | {r['cpu_seconds_per_update']:.2f} "
            f"| {r['peak_memory_mb']:,.0f} | {reference or 'none'} |"
        )
    return "\n".join(lines)
