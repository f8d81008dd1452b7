"""FoundationStereo on the CPU, beside the reference's figures where the specification has some.

Weights are random: they change neither time nor memory. CPU seconds stand beside wall seconds because on
a busy machine only they repeat. Peak memory is that of a process of its own, network included.
"""

from __future__ import annotations

import time
from typing import Any

import torch
from processes import apart, peak_mb
from tabulated import numbers

from sfkit.architectures.foundation_stereo import foundation_stereo

DOCUMENT = "benchmarks/README.md"
SMALL = {"height": 128, "width": 256, "max_disp": 192}
CASES: tuple[tuple[dict[str, Any], str], ...] = (
    ({"vit_size": "vits", **SMALL}, "12 s, 1.3 GB"),
    ({"vit_size": "vitl", **SMALL}, "15 to 55 s, 3.7 GB"),
    ({"vit_size": "vits"}, "none"),
    ({"vit_size": "vits", "low_memory": True}, "none"),
)
"""What :func:`measure` is given, and the reference's figures."""
ITERATIONS = 4


def measure(
    vit_size: str, height: int = 480, width: int = 640, max_disp: int = 416, low_memory: bool = False
) -> tuple[str, ...]:
    """One forward pass of a height x width pair: a row of the table.

    Wall and CPU seconds of the whole pass; CPU seconds of features, volume and context; those of an update,
    the mean over all, the final upsampling included; the peak memory of the process, MB.
    """
    network = foundation_stereo(
        vit_size=vit_size, max_disp=max_disp, iterations=ITERATIONS, low_memory=low_memory
    )
    left, right = 255 * torch.rand(2, 1, 3, height, width, generator=torch.Generator().manual_seed(0))
    updates: list[float] = []
    network.update_block.register_forward_pre_hook(lambda *_: updates.append(time.process_time()))
    wall, cpu = time.perf_counter(), time.process_time()
    with torch.inference_mode():
        network(left, right)
    wall, end = time.perf_counter() - wall, time.process_time()
    return (
        f"{vit_size}{', low memory' * low_memory}",
        f"{width} x {height}",
        *(f"{seconds:.1f}" for seconds in (wall, end - cpu, updates[0] - cpu)),
        f"{(end - updates[0]) / ITERATIONS:.2f}",
        f"{peak_mb():,.0f}",
    )


def section() -> str:
    """One row a case, in a process of its own."""
    times = ("wall s", "CPU s", "of it before the updates", "an update", "peak MB")
    rows = [(*apart(measure, **case), reference) for case, reference in CASES]
    return f"""## FoundationStereo, one disparity map on the CPU

Random weights, {ITERATIONS} iterations; a run of 32 adds 28 updates. The reference's figures are of its
specification, measured on another, busy machine.

{numbers(("case", "image, px", *times, "reference"), rows)}"""
