"""Time and memory of one FoundationStereo disparity map on the CPU.

    python benchmarks/foundation_stereo_speed.py --iterations 32
    python benchmarks/foundation_stereo_speed.py --low-memory --json

Weights are random: they change neither time nor memory. CPU seconds are printed beside wall seconds
because on a busy machine only they repeat. Peak memory is that of the process, network included.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections.abc import Sequence
from typing import Any

import torch

from sfkit.architectures.foundation_stereo import foundation_stereo


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
        "peak_memory_mb": round(_peak_memory_mb()),
    }


def _peak_memory_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure once and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--vit-size", default="vits")
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--max-disp", type=int, default=416)
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--low-memory", action="store_true")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = vars(parser.parse_args(arguments))
    as_json = options.pop("json")
    result = measure(**options)
    if as_json:
        print(json.dumps(result))
    else:
        print("\n".join(f"{key:28} {value}" for key, value in result.items()))


if __name__ == "__main__":
    main()
