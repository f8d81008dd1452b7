"""One step of a pool's life, alone in its process; ``bigpool.py`` calls it.

    python benchmarks/pool_steps.py merge FOLDER/pool3.toml

Prints seconds as one JSON object. Results are checked: merged weights against a mean of the files, and
that the network's parameters are views into the merge's buffer.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from sfkit.architectures import architecture
from sfkit.checkpoints import read_checkpoint, read_pool_spec
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.evaluation import Evaluator
from sfkit.merging import LiveModel, Pool, Recipe, open_pool, routed
from sfkit.merging.saving import save_merged

REPEATS = 7
READ_AT_ONCE = 4 << 20  # bytes


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Wall seconds of a call, and what it returned."""
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def read(path: Path) -> dict[str, Any]:
    """Read every file of the pool from beginning to end and do nothing with it."""
    spec = read_pool_spec(path)
    buffer = bytearray(READ_AT_ONCE)
    started = time.perf_counter()
    for member in (spec.base, *spec.sources):
        with member.path.open("rb", buffering=0) as stream:
            while stream.readinto(buffer):
                pass
    return {"read_seconds": time.perf_counter() - started}


def opened(path: Path) -> dict[str, Any]:
    """Open the pool."""
    before = time.process_time()
    seconds, pool = timed(lambda: open_pool(path))
    sizes = {"values": sum(spec.size for spec in pool.specs), "changed": pool.layout.size}
    return {"open_seconds": seconds, "cpu_seconds": time.process_time() - before, **sizes}


def merge(path: Path) -> dict[str, Any]:
    """Make the live network, then merge into it again and again: the shortest time counts."""
    pool = open_pool(path)
    network_seconds, live = timed(lambda: pool.merge(pool.uniform()))
    equal = min(timed(lambda: live.apply(pool.uniform()))[0] for _ in range(REPEATS))
    _check(pool, live)
    recipe = _routed(pool)
    split = min(timed(lambda: live.apply(recipe))[0] for _ in range(REPEATS))
    moved = (len(pool.names) + 1) * 4 * pool.layout.size
    seconds = {"network_seconds": network_seconds, "equal_seconds": equal, "routed_seconds": split}
    return {**seconds, "bytes_read": moved}


def write(path: Path) -> dict[str, Any]:
    """Write the merged network to a file."""
    pool = open_pool(path)
    seconds, written = timed(lambda: save_merged(pool, pool.uniform(), path.parent / "merged.safetensors"))
    Path(written).unlink()
    return {"write_seconds": seconds}


def evaluate(path: Path) -> dict[str, Any]:
    """Evaluate the equal-weight and a routed merge on one small rendered pair."""
    pool = open_pool(path)
    pair = synthetic_pair(next(iter(domains().values())), 0, split="benchmark", height=96, width=160)
    benchmark = memory_benchmark("one", [Sample("0", pair.left, pair.right, pair.disparity)])
    evaluator = Evaluator(pool, benchmark)
    seconds, outcomes = timed(lambda: evaluator([pool.uniform(), _routed(pool)]))
    if errors := [outcome.error for outcome in outcomes if outcome.error]:
        raise SystemExit(f"an evaluation failed: {errors}")
    return {"evaluation_seconds": seconds / 2}


def average(path: Path) -> dict[str, Any]:
    """The usual way: load every state dict, average key by key, load the result into a network."""
    spec = read_pool_spec(path)
    load_seconds, states = timed(
        lambda: [torch.load(s.path, map_location="cpu", weights_only=True)["model"] for s in spec.sources]
    )
    mean_seconds, mean = timed(lambda: {key: _average([s[key] for s in states]) for key in states[0]})
    network = architecture(spec.architecture).build(**spec.options)
    seconds, _ = timed(lambda: network.load_state_dict(mean))
    return {"load_seconds": load_seconds, "average_seconds": mean_seconds + seconds}


STEPS = {step.__name__: step for step in (read, merge, write, evaluate, average)} | {"open": opened}


def _routed(pool: Pool) -> Recipe:
    """Block-specific weights that no two sources share."""
    sources, blocks = len(pool.names), len(pool.blocks)
    rows = [[1.0 + (e + b) % sources for e in range(sources)] for b in range(blocks)]
    weights = [[w / sum(row) for w in row] for row in rows]
    return routed(pool.names, pool.blocks, weights, [1.0 + 0.1 * b for b in range(blocks)])


def _average(values: list[torch.Tensor]) -> torch.Tensor:
    return torch.stack(values).mean(0) if values[0].is_floating_point() else values[0]


def _check(pool: Pool, live: LiveModel) -> None:
    """Compare some merged tensors with a mean of the files, and see that they are views.

    Raises:
        SystemExit: they differ, or are copies.
    """
    files = [read_checkpoint(source.path).tensors for source in pool.sources]
    held = live.network.state_dict(keep_vars=True)
    storage = live.flat.untyped_storage().data_ptr()
    for spec, _ in pool.layout.entries[:: max(1, len(pool.layout.entries) // 20)]:
        mean = torch.zeros(spec.shape, dtype=torch.float64)
        for file in files:
            mean += file[spec.key].double() / len(files)
        if not torch.allclose(held[spec.key].double(), mean, atol=1e-5):
            raise SystemExit(f"{spec.key}: the merge is not the mean of the files")
        if held[spec.key].untyped_storage().data_ptr() != storage:
            raise SystemExit(f"{spec.key}: the parameter is a copy, no view")


if __name__ == "__main__":
    print(json.dumps(STEPS[sys.argv[1]](Path(sys.argv[2]))))
