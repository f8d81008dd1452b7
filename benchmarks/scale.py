"""Past this machine: searches on 1 to 256 workers, simulated from measured times of evaluations.

    python benchmarks/scale.py [--json]

Two searches: the paper's on FoundationStereo (Stage 1 took 1.2 h and Stage 2 2.4 h on 4 GPUs), and ours on
the embedded bank, whose seconds an evaluation are measured here. Within a generation workers take evaluations
in turn, and the next generation begins when all are done; that wait is the barrier. Stage 1 evaluates the new
subsets of each generation, as many as our search proposes on the bank; Stage 2 evaluates CMA-ES populations.
With images shared out, the engines' own schedule (``sfkit.evaluation.engines.schedule``) cuts evaluations by
images at a generation's end. Not simulated: machines that differ, and messages that are lost.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from exhaustive import subset_scores
from landscapes import Landscape
from pictures import lines, picture
from processes import answered, shown
from search import genetic
from tabulated import numbers

from sfkit import Evaluator, bank, open_pool
from sfkit.evaluation.engines.schedule import Board
from sfkit.search import SubsetSettings

DOCUMENT = "benchmarks/README.md"

WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
TRIALS = 300  # of Stage 2
DIMENSIONS = 4 * 6 + 4  # of Stage 2; CMA-ES proposes 4 + 3 ln n at a time
SPREAD = 0.05  # standard deviation of an evaluation's time over its mean, as measured on the bank
FASTEST = 1.25e9  # bytes a second from one machine to the next: 10 Gbit Ethernet


@dataclass(frozen=True)
class SimulatedSearch:
    """A search to simulate.

    Attributes:
        name: for people.
        images: of the validation benchmark.
        stage1: seconds an evaluation of Stage 1 takes on one worker.
        stage2: the same of Stage 2.
        merge: seconds of an evaluation that every worker repeats when images are shared out.
        vectors: bytes of base and task vectors that a worker holds.
    """

    name: str
    images: int
    stage1: float
    stage2: float
    merge: float
    vectors: int


@cache
def generations() -> tuple[int, ...]:
    """New subsets in each generation of our Stage 1 on the bank, seed 0, the paper's settings."""
    land, settings = Landscape(subset_scores()), SubsetSettings()
    masks, seen, found = genetic(settings)(land, 0), set[int](), []
    for first in range(0, len(masks), settings.population):
        new = set(masks[first : first + settings.population]) - seen
        seen |= new
        found.append(len(new))
    return tuple(found)


def populations(dimensions: int) -> tuple[int, ...]:
    """CMA-ES populations of 4 + 3 ln n that make up the trials of Stage 2."""
    size = 4 + math.floor(3 * math.log(dimensions))
    rest = TRIALS % size
    return (size,) * (TRIALS // size) + ((rest,) if rest else ())


def paper() -> SimulatedSearch:
    """FoundationStereo ViT-L, 11 sources, 27 pairs: seconds such that 4 GPUs need 1.2 h and 2.4 h."""
    first, second = (
        hours * 3600 / simulate(batches, 1.0, 4)[0]
        for hours, batches in ((1.2, generations()), (2.4, populations(DIMENSIONS)))
    )
    parameters = 37_600_000  # that the sources change; the ViT is frozen
    return SimulatedSearch("paper, FoundationStereo", 27, first, second, 0.05, 12 * 4 * parameters)


def embedded(pairs: int = 8) -> SimulatedSearch:
    """The bank on this machine's CPU, measured on a few subsets."""
    torch.set_num_threads(1)
    pool = open_pool(bank.pool_path())
    with Evaluator(pool, bank.benchmark(bank.VALIDATION).first(pairs)) as scorer:
        scorer([pool.equal(name) for name in pool.names[:2]])
        each = min(outcome.seconds for outcome in scorer([pool.equal(name) for name in pool.names[2:8]]))
        live = pool.merge(pool.uniform())
        began = time.perf_counter()
        live.apply(pool.uniform())
        spent = time.perf_counter() - began
    return SimulatedSearch("bank, AnyNet", pairs, each, each, spent, 12 * 4 * pool.layout.size)


def simulate(
    batches: Sequence[int], seconds: float, workers: int, *, images: int = 1, merge: float = 0.0
) -> tuple[float, float]:
    """Wall seconds, and seconds in which workers worked, of batches that each begin after the one before.

    Args:
        batches: evaluations in each.
        seconds: that an evaluation takes on one worker.
        workers: how many.
        images: into how many an evaluation may be cut; 1 keeps it whole. The engines' own ``Board`` cuts.
        merge: seconds of an evaluation that are spent anew for every part.
    """
    rng = np.random.default_rng(0)
    wall = busy = 0.0
    for count in batches:
        board = Board(count, images, workers)
        factors = np.maximum(0.5, rng.normal(1.0, SPREAD, count))
        free = [0.0] * workers
        while (part := board.take()) is not None:
            share = (part.stop - part.start) / images
            spent = (merge + (seconds - merge) * share) * float(factors[part.number])
            busy += spent
            heapq.heappush(free, heapq.heappop(free) + spent)
        wall += max(free)
    return wall, busy


def run(case: SimulatedSearch, workers: int) -> dict[str, Any]:
    """Both stages, whole evaluations and images shared out; idle: what the barrier costs of workers' time."""
    stages = ((generations(), case.stage1), (populations(DIMENSIONS), case.stage2))

    def spent(images: int, merge: float) -> tuple[float, float]:
        every = [simulate(*stage, workers, images=images, merge=merge) for stage in stages]
        wall, busy = (sum(column) for column in zip(*every, strict=True))
        return wall / 3600, max(0.0, 1 - busy / (wall * workers))

    hours, idle = spent(1, 0.0)
    hours_shared, idle_shared = spent(case.images, case.merge)
    return {
        "case": case.name,
        "workers": workers,
        "hours": hours,
        "idle": idle,
        "hours_shared": hours_shared,
        "idle_shared": idle_shared,
        "broadcast": case.vectors / FASTEST * math.ceil(math.log2(workers + 1)),
        "memory": case.vectors / 2**30,
    }


def measure() -> list[dict[str, Any]]:
    """Every case on every number of workers."""
    return [run(case, workers) for case in (paper(), embedded()) for workers in WORKERS]


COLUMNS = {
    "search": "{case}",
    "workers": "{workers}",
    "hours": "{hours:.3g}",
    "idle at the barrier": "{idle:.0%}",
    "hours, images shared": "{hours_shared:.3g}",
    "idle": "{idle_shared:.0%}",
    "broadcast, s": "{broadcast:.2f}",
    "vectors a worker, GiB": "{memory:.3f}",
}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table."""
    cells = ([shape.format(**row).replace("%", " %") for shape in COLUMNS.values()] for row in rows)
    return numbers(list(COLUMNS), cells)


def section() -> str:
    """The table, a picture, and what to build next."""
    rows = measure()
    curves = {}
    for case in dict.fromkeys(row["case"] for row in rows):
        of_case = [row for row in rows if row["case"] == case]
        for key, told in (("idle", "whole evaluations"), ("idle_shared", "images shared out")):
            curves[f"{case}: {told}"] = (WORKERS, [100 * row[key] for row in of_case])
    many = next(row for row in rows if row["workers"] == 64)
    most = next(row for row in reversed(rows) if row["case"] == many["case"])
    idle, rest = f"{100 * many['idle']:.1f}", f"{100 * many['idle_shared']:.1f}"
    figure = lines(
        curves,
        title="How much of the workers' time does the generation barrier cost?",
        subtitle=f"{many['case']}, 64 workers: {100 * many['idle']:.0f} %, with images shared out {rest} %",
        x="workers",
        y="idle (%)",
        logarithmic=True,
    )
    verdict = (
        "The rest is above 10 %, so what to build next is an asynchronous Stage 2 whose\nresults enter by "
        "candidate number, or larger populations where there are many workers."
        if many["idle_shared"] > 0.1
        else "That is under 10 %:\nno asynchronous variant is needed up to there."
    )
    return f"""## Past this machine: 1 to 256 workers, simulated

`{shown("scale.py")}`: the paper's hours on 4 GPUs, and the bank's seconds an evaluation as measured here;
new subsets a generation as Stage 1 proposes them on the bank, CMA-ES populations of 13 or 14, evaluations
that differ by 5 %. The engines' own schedule shares images out. Broadcast is over 10 Gbit Ethernet, in a
tree.

{picture(figure, "scale", "Idle share of workers against their number")}

{table(rows)}

At 64 workers the barrier idles {idle} % of the paper's search while evaluations stay whole, and {rest} % with
images shared out, which every engine does by itself. {verdict} Task vectors are no obstacle:
{most["memory"]:.1f} GiB a worker, sent to {most["workers"]} in {most["broadcast"]:.0f} s."""


if __name__ == "__main__":
    answered(measure, table)
