"""NMRF on the CPU, beside the original code's figures, and where the time goes.

Weights are random: they change neither time nor memory. CPU seconds stand beside wall time because on a
busy machine only they repeat. Peak memory is that of a process of its own, network included.
"""

from __future__ import annotations

import time
from collections import defaultdict
from functools import partial

import torch
from processes import apart, peak_mb
from tabulated import numbers
from torch import nn

from sfkit.architectures import NMRF, architecture

DOCUMENT = "benchmarks/README.md"

# The original code at 384 x 1248, two threads on a busy machine: wall s, CPU s, peak MB of the process.
ORIGINAL = {"nmrf-swint": ("30.3", "20.6", "1,710"), "nmrf-res": ("22.5", "19.2", "1,390")}
SIZE, THREADS = (384, 1248), 2


def measure(name: str) -> tuple[tuple[str, ...], str]:
    """One forward pass of a pair, after a small one to warm up.

    Returns:
        Wall and CPU seconds of the pass and peak memory of the process in MB; CPU seconds by part.
    """
    torch.set_num_threads(THREADS)
    network = architecture(name).build().eval()
    assert isinstance(network, NMRF)
    parts = {network.encoder_name: "encoder", "concatconv": "matching", "gw": "matching"}
    parts |= {part: part for part in ("dpn", "inference", "refinement")}
    left, right = 255 * torch.rand(2, 1, 3, *SIZE, generator=torch.Generator().manual_seed(0))
    spent: dict[str, float] = defaultdict(float)
    with torch.inference_mode():
        network(left[..., :64, :64], right[..., :64, :64])
        for module, part in parts.items():
            _clock(network.get_submodule(module), part, spent)
        wall, cpu = time.perf_counter(), time.process_time()
        network(left, right)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    spent["rest"] = cpu - sum(spent.values())
    order = dict.fromkeys([*parts.values(), "rest"])
    told = ", ".join(f"{part} {spent[part]:.1f}" for part in order)
    return (f"{wall:.1f}", f"{cpu:.1f}", f"{peak_mb():,.0f}"), told


def _clock(module: nn.Module, part: str, spent: dict[str, float]) -> None:
    """Add the CPU seconds of every call of ``module`` to ``spent[part]``."""

    def add(sign: int, *_: object) -> None:
        spent[part] += sign * time.process_time()

    module.register_forward_pre_hook(partial(add, -1))
    module.register_forward_hook(partial(add, 1))


def section() -> str:
    """One row a variant at 384 x 1248."""
    measured = [(name, *apart(measure, name), theirs) for name, theirs in ORIGINAL.items()]
    rows = [(name, *ours, *theirs, spent) for name, ours, spent, theirs in measured]
    figures = ("wall s", "CPU s", "peak MB", "original: wall s", "CPU s", "peak MB")
    return f"""## NMRF, one disparity map of 384 x 1248 on the CPU

Two threads, whose CPU seconds are both counted; the original code's figures are of its specification,
measured with two threads on another, busy machine.

{numbers(("variant", *figures, "ours by part, CPU s"), rows)}"""
