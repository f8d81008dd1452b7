"""NMRF on the CPU, beside the original code's figures, and where the time goes.

Weights are random: they change neither time nor memory. CPU seconds stand beside wall time because on a
busy machine only they repeat. Peak memory is that of a process of its own, network included.
"""

from __future__ import annotations

import time
from collections import defaultdict
from typing import Any

import torch
from processes import apart, peak_mb
from torch import nn

from sfkit.analysis.tables import markdown_lines
from sfkit.architectures import NMRF, architecture

DOCUMENT = "benchmarks/README.md"

# The original code at 384 x 1248, two threads on a busy machine: wall ms, CPU s, peak MB of the process.
ORIGINAL = {"nmrf-swint": (30_300, 20.6, 1710), "nmrf-res": (22_500, 19.2, 1390)}


def measure(name: str, *, height: int = 384, width: int = 1248, threads: int = 2) -> dict[str, Any]:
    """One forward pass of a height x width pair, after a small one to warm up.

    Returns:
        The settings, and: ``wall_ms`` and ``cpu_seconds`` of the pass; ``cpu_seconds_of`` each part;
        ``peak_memory_mb`` of the process.

    Raises:
        InputError: ``name`` is no architecture, or it cannot read images of this size.
    """
    torch.set_num_threads(threads)
    network = architecture(name).build().eval()
    assert isinstance(network, NMRF)
    parts = {network.encoder_name: "encoder", "concatconv": "matching", "gw": "matching"}
    parts |= {part: part for part in ("dpn", "inference", "refinement")}
    generator = torch.Generator().manual_seed(0)
    left, right = 255 * torch.rand(2, 1, 3, height, width, generator=generator)
    spent: dict[str, float] = defaultdict(float)
    with torch.inference_mode():
        network(left[..., :64, :64], right[..., :64, :64])
        for module, part in parts.items():
            _clock(network.get_submodule(module), part, spent)
        wall, cpu = time.perf_counter(), time.process_time()
        network(left, right)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    spent["rest"] = cpu - sum(spent.values())
    return {
        "name": name,
        "height": height,
        "width": width,
        "threads": threads,
        "wall_ms": round(1000 * wall),
        "cpu_seconds": round(cpu, 2),
        "cpu_seconds_of": {part: round(seconds, 2) for part, seconds in spent.items()},
        "peak_memory_mb": round(peak_mb()),
    }


def _clock(module: nn.Module, part: str, spent: dict[str, float]) -> None:
    """Add the CPU seconds of every call of ``module`` to ``spent[part]``."""
    started: list[float] = []
    module.register_forward_pre_hook(lambda *_: started.append(time.process_time()))

    def stop(*_: object) -> None:
        spent[part] += time.process_time() - started.pop()

    module.register_forward_hook(stop)


def section() -> str:
    """One row a variant at 384 x 1248."""
    parts = ("encoder", "matching", "dpn", "inference", "refinement", "rest")
    theirs = ("original: wall s", "CPU s", "peak MB")
    rows = []
    for name, (wall, cpu, memory) in ORIGINAL.items():
        r = apart(measure, name)
        spent = ", ".join(f"{part} {r['cpu_seconds_of'][part]:.1f}" for part in parts)
        ours = (f"{r['wall_ms'] / 1000:.1f}", f"{r['cpu_seconds']:.1f}", f"{r['peak_memory_mb']:,}")
        rows.append((name, *ours, f"{wall / 1000:.1f}", f"{cpu:.1f}", f"{memory:,}", spent))
    columns = ("variant", "wall s", "CPU s", "peak MB", *theirs, "ours by part, CPU s")
    return f"""## NMRF, one disparity map of 384 x 1248 on the CPU

Two threads, whose CPU seconds are both counted; the original code's figures are of its specification,
measured with two threads on another, busy machine.

{markdown_lines(columns, rows, [False, *[True] * 6, False])}"""
