"""FoundationStereo on the CPU, beside the reference's figures where the specification has some.

Weights are random: they change neither time nor memory. CPU seconds stand beside wall seconds because on
a busy machine only they repeat. Peak memory is that of a process of its own, network included.
"""

from __future__ import annotations

import time
from typing import Any

import torch
from processes import apart, peak_mb

from sfkit.analysis.tables import markdown_lines
from sfkit.architectures.foundation_stereo import foundation_stereo

DOCUMENT = "benchmarks/README.md"
SMALL = {"height": 128, "width": 256, "max_disp": 192}
CASES: tuple[tuple[dict[str, Any], str], ...] = (
    ({"vit_size": "vits", **SMALL}, "12 s, 1.3 GB"),
    ({"vit_size": "vitl", **SMALL}, "15 to 55 s, 3.7 GB"),
    ({"vit_size": "vits"}, ""),
    ({"vit_size": "vits", "low_memory": True}, ""),
)
"""What :func:`measure` is given, and the reference's figures."""


def measure(
    *,
    vit_size: str = "vits",
    height: int = 480,
    width: int = 640,
    max_disp: int = 416,
    iterations: int = 4,
    low_memory: bool = False,
) -> dict[str, Any]:
    """One forward pass of a height x width pair.

    Returns:
        The settings, and: ``wall_seconds`` and ``cpu_seconds`` of the whole pass;
        ``cpu_seconds_before_updates`` for features, volume and context; ``cpu_seconds_per_update``, the
        mean over all updates, the final upsampling included; ``peak_memory_mb`` of the process.
    """
    settings = {key: value for key, value in locals().items() if key not in ("height", "width")}
    network = foundation_stereo(**settings)
    left, right = 255 * torch.rand(2, 1, 3, height, width, generator=torch.Generator().manual_seed(0))
    updates: list[float] = []
    network.update_block.register_forward_pre_hook(lambda *_: updates.append(time.process_time()))
    wall, cpu = time.perf_counter(), time.process_time()
    with torch.inference_mode():
        network(left, right)
    end = time.process_time()
    return {
        **settings,
        "height": height,
        "width": width,
        "threads": torch.get_num_threads(),
        "wall_seconds": round(time.perf_counter() - wall, 2),
        "cpu_seconds": round(end - cpu, 2),
        "cpu_seconds_before_updates": round(updates[0] - cpu, 2),
        "cpu_seconds_per_update": round((end - updates[0]) / iterations, 2),
        "peak_memory_mb": round(peak_mb()),
    }


def section() -> str:
    """One row a case."""
    columns = (
        "case",
        "image, px",
        "wall s",
        "CPU s",
        "of it before the updates",
        "an update",
        "peak MB",
        "reference",
    )
    rows = []
    for case, reference in CASES:
        r = apart(measure, **case)
        rows.append(
            (
                f"{r['vit_size']}{', low memory' * r['low_memory']}",
                f"{r['width']} x {r['height']}",
                f"{r['wall_seconds']:.1f}",
                f"{r['cpu_seconds']:.1f}",
                f"{r['cpu_seconds_before_updates']:.1f}",
                f"{r['cpu_seconds_per_update']:.2f}",
                f"{r['peak_memory_mb']:,.0f}",
                reference or "none",
            )
        )
    return f"""## FoundationStereo, one disparity map on the CPU

Random weights, 4 iterations; a run of 32 adds 28 updates. The reference's figures are of its specification,
measured on another, busy machine.

{markdown_lines(columns, rows, [False, *[True] * 6, False])}"""
