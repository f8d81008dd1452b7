"""Time and memory of one NMRF disparity map on the CPU, and where the time goes.

    python benchmarks/nmrf_speed.py nmrf-res
    python benchmarks/nmrf_speed.py nmrf-swint --threads 2 --json

Weights are random: they change neither time nor memory. CPU seconds stand beside wall milliseconds
because on a busy machine only they repeat. Peak memory is that of the process, network included, so
measure one variant a process.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

from sfkit.architectures import NMRF, architecture

# The original code at 384 x 1248, two threads on a busy machine: wall ms, CPU s, peak MB of the process.
ORIGINAL = {"nmrf-swint": (30_300, 20.6, 1710), "nmrf-res": (22_500, 19.2, 1390)}


def measure(
    name: str = "nmrf-res", *, height: int = 384, width: int = 1248, threads: int = 1
) -> dict[str, Any]:
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
        "peak_memory_mb": round(_peak_memory_mb()),
    }


def _clock(module: nn.Module, part: str, spent: dict[str, float]) -> None:
    """Add the CPU seconds of every call of ``module`` to ``spent[part]``."""
    started: list[float] = []
    module.register_forward_pre_hook(lambda *_: started.append(time.process_time()))

    def stop(*_: object) -> None:
        spent[part] += time.process_time() - started.pop()

    module.register_forward_hook(stop)


def _peak_memory_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure once and print, at the default size beside the original's figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("name", nargs="?", default="nmrf-res", choices=sorted(ORIGINAL))
    parser.add_argument("--height", type=int, default=384)
    parser.add_argument("--width", type=int, default=1248)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = vars(parser.parse_args(arguments))
    as_json = options.pop("json")
    result = measure(**options)
    if as_json:
        print(json.dumps(result))
        return
    for key, value in result.items():
        print(f"{key:16} {value}")
    if (result["height"], result["width"]) == (384, 1248):
        wall, cpu, memory = ORIGINAL[result["name"]]
        print(
            f"{'original':16} wall_ms {wall}, cpu_seconds {cpu}, peak_memory_mb {memory} (two threads, busy)"
        )


if __name__ == "__main__":
    main()
