"""TIES for ``merging.py``: how long it takes beside the speed of memory, and beside mergekit where installed.

The limit is that of a linear merge of the same sources: base and task vectors read once, the result written
once. One lambda needs a threshold for each source and the election; each further lambda is a merge of the one
elected vector, and another electing rule finds the thresholds it had.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from functools import partial

import torch
from memory import SOURCES, MergeTime, RandomPool, bandwidth, best_of

from sfkit.merging.fusion import fuse
from sfkit.merging.linear import weighted_sum
from sfkit.merging.sparsity import Piece, Row, Thresholds, thinned
from sfkit.merging.steps import Elect, Trim


def part_of(vector: torch.Tensor, piece: Piece) -> torch.Tensor:
    """A piece of a task vector as it was read."""
    return vector[piece.start : piece.stop]


def elected(world: RandomPool, density: float, known: Thresholds, out: torch.Tensor) -> torch.Tensor:
    """The task vector that TIES makes of all sources."""
    step = Trim(density)
    read = [Row(n, partial(part_of, v)) for n, v in zip(world.names, world.vectors, strict=True)]
    known.find(read, step, world.layout)
    rows = [thinned(row, step, world.layout, f"{row.fingerprint} trimmed", known) for row in read]
    fuse(Elect(), rows, world.layout, out)
    return out


def measure(elements: int, threads: int, density: float) -> list[MergeTime]:
    """One lambda, one more, and another election with the thresholds known; checked on one tensor."""
    torch.set_num_threads(threads)
    world = RandomPool(elements)
    _, triad = bandwidth(max(elements, 1 << 26))
    size = world.layout.size
    limit = 4 * size * (SOURCES + 2) / triad
    vector, records = torch.empty(size), []

    def record(name: str, seconds: float) -> None:
        records.append(MergeTime(name, size, threads, 1e3 * seconds, 1e3 * limit))

    def once() -> None:
        elected(world, density, Thresholds(), vector)
        weighted_sum(world.base, [(vector, 1.0)], world.out, 0, size)

    record("TIES, one lambda", best_of(once, 2))
    check(world, density, vector)
    further = best_of(lambda: weighted_sum(world.base, [(vector, 0.8)], world.out, 0, size))
    record("TIES, each further lambda", further)
    known = Thresholds()
    elected(world, density, known, vector)
    record("TIES, thresholds known", best_of(lambda: elected(world, density, known, vector), 2))
    if importlib.util.find_spec("mergekit"):
        work = mergekit_work(world, density)
        started = time.perf_counter()
        work()  # once: at full size it takes a minute
        record("mergekit ties", time.perf_counter() - started)
    return records


def check(world: RandomPool, density: float, found: torch.Tensor) -> None:
    """The elected vector is that of the formula, on the first tensor."""
    part = slice(0, world.layout.entries[0][0].size)
    size = world.layout.size
    kept = []
    for vector in world.vectors:
        smallest = torch.topk(vector.abs(), int(density * size)).values[-1]
        kept.append(torch.where(vector[part].abs() >= smallest, vector[part], 0.0))
    stack = torch.stack(kept).double()
    agree = stack.sign() == stack.sum(dim=0).sign()
    expected = (stack * agree).sum(dim=0) / (agree & (stack != 0)).sum(dim=0).clamp(min=1)
    if not torch.allclose(found[part].double(), expected, atol=1e-5):
        raise SystemExit("the elected task vector is not that of the formula")


def mergekit_work(world: RandomPool, density: float) -> Callable[[], object]:
    """TIES by mergekit, which trims each tensor by itself."""
    from mergekit.merge_methods.api import merge_state_dicts

    base = world.layout.views(world.base)
    models = {n: world.layout.views(v) for n, v in zip(world.names, world.vectors, strict=True)}
    options = {"weight": dict.fromkeys(models, 1.0), "density": dict.fromkeys(models, density)}

    def work() -> object:
        with torch.inference_mode():
            return merge_state_dicts({"base": base, **models}, "ties", parameters=options, base="base")

    return work
