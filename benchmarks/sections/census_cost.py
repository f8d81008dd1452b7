"""What ``census`` costs beside the pass whose map it scores: a real AnyNet at KITTI's size, on the CPU.

CPU seconds of one thread, the shortest of several rounds in which all take turns: on a busy machine only they
repeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import real_pairs
import torch
from tabulated import numbers

import sfkit
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets.census import CensusTarget
from sfkit.exporting.export import rendered_pair
from sfkit.merging.live import LiveModel

DOCUMENT = "benchmarks/README.md"

SIZE, ROUNDS = (384, 1248), 25


def measure(size: tuple[int, int] = SIZE, rounds: int = ROUNDS) -> list[tuple[str, list[float]]]:
    """With the propagation stage and without, CPU ms of a pass, of a candidate and of making a pair ready."""
    torch.set_num_threads(1)
    images = rendered_pair(size)
    target = CensusTarget(*images)
    rows = []
    for stage, spn in (("with propagation", True), ("without", False)):
        pool = sfkit.open_pool(replace(read_pool_spec(real_pairs.POOL), options={"spn": spn}))
        live = LiveModel(pool)
        live.apply(pool.uniform())
        pair = pool.architecture.inputs(pool.options).prepare(*images)
        run = partial(live.disparity, pair.left, pair.right)
        score = partial(target.residual, pair.window.crop(run()))
        rows.append((stage, _shortest((run, score, partial(CensusTarget, *images)), rounds)))
    return rows


def _shortest(calls: tuple[Callable[[], object], ...], rounds: int) -> list[float]:
    best = [float("inf")] * len(calls)
    for _ in range(rounds):
        for number, call in enumerate(calls):
            started = time.process_time()
            call()
            best[number] = min(best[number], 1e3 * (time.process_time() - started))
    return best


def section() -> str:
    """A row with the propagation stage, one without."""
    heads = ("stage", "pass, ms", "a candidate, ms", "of a pass, %", "once a pair, ms", "passes")
    lines = [
        (
            stage,
            f"{whole:.1f}",
            f"{each:.1f}",
            f"{100 * each / whole:.1f}",
            f"{once:.1f}",
            f"{once / whole:.2f}",
        )
        for stage, (whole, each, once) in measure()
    ]
    return f"""## The census metric beside AnyNet's pass

Scoring a map without ground truth, at {SIZE[0]} x {SIZE[1]} on the CPU: a merge of four real AnyNet sources
on a rendered pair, its pass as a search runs it, and `census` of its map. The pair is made ready (both images
smoothed, the left one's bits) once, for all candidates of a search. CPU milliseconds of one thread, the
shortest of {ROUNDS} rounds that take turns.

{numbers(heads, lines)}"""
