"""AnyNet on the CPU: the fast route against plain 3-D convolutions."""

from __future__ import annotations

from processes import call, shown

DOCUMENT = "benchmarks/README.md"

COMMAND = ("anynet_speed.py", "--json")


def section() -> str:
    """One row a size and number of threads."""
    rows = call(*COMMAND)
    lines = [
        "## AnyNet, one disparity map on the CPU",
        "",
        f"`{shown(*COMMAND)}`: shortest of several passes that take turns; both routes give the same map.",
        "",
        "| height x width | threads | plain Conv3d, ms | fast route, ms | ratio |",
        "|---|--:|--:|--:|--:|",
    ]
    for r in rows:
        lines.append(
            f"| {r['height']} x {r['width']} | {r['threads']} | {r['plain_ms']:.1f} | {r['fast_ms']:.1f} "
            f"| {r['ratio']:.2f} |"
        )
    return "\n".join(lines)
