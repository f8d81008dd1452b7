"""Past this machine: the paper's search on 1 to 256 workers, simulated from its hours.

    python benchmarks/scale.py [--json]

On FoundationStereo Stage 1 took 1.2 h and Stage 2 2.4 h on 4 GPUs. Within a generation workers take
evaluations in turn, and the next generation begins when all are done; that wait is the barrier. Stage 1
evaluates the new subsets of each generation, as many as our search proposes on the first bank; Stage 2
evaluates CMA-ES populations.
With images shared out, the engines' own schedule (``sfkit.evaluation.engines.schedule``) cuts evaluations by
images at a generation's end. Not simulated: machines that differ, and messages that are lost.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from exhaustive import subset_scores
from landscapes import Landscape
from pictures import lines, picture
from processes import answered, shown
from search import genetic
from tabulated import numbers

from sfkit.evaluation.engines.schedule import Board
from sfkit.search import SubsetSettings

DOCUMENT = "benchmarks/README.md"

WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
TRIALS = 300  # of Stage 2
DIMENSIONS = 4 * 6 + 4  # of Stage 2; CMA-ES proposes 4 + 3 ln n at a time
SPREAD = 0.05  # standard deviation of an evaluation's time over its mean, as measured on the first bank
IMAGES = 27  # of the paper's validation
MERGE = 0.05  # seconds of an evaluation that every worker repeats when images are shared out
VECTORS = 12 * 4 * 37_600_000  # bytes of base and 11 task vectors; the ViT is frozen
FASTEST = 1.25e9  # bytes a second from one machine to the next: 10 Gbit Ethernet


@cache
def generations() -> tuple[int, ...]:
    """New subsets in each generation of our Stage 1 on the first bank, seed 0, the paper's settings."""
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


@cache
def stages() -> tuple[tuple[tuple[int, ...], float], ...]:
    """Evaluations of each batch, and seconds of one such that 4 GPUs need 1.2 h and 2.4 h; by stage."""
    batches = ((1.2, generations()), (2.4, populations(DIMENSIONS)))
    return tuple((counts, hours * 3600 / simulate(counts, 1.0, 4)[0]) for hours, counts in batches)


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


def run(workers: int) -> dict[str, Any]:
    """Both stages, whole evaluations and images shared out; idle: what the barrier costs of workers' time."""

    def spent(images: int, merge: float) -> tuple[float, float]:
        every = [simulate(*stage, workers, images=images, merge=merge) for stage in stages()]
        wall, busy = (sum(column) for column in zip(*every, strict=True))
        return wall / 3600, max(0.0, 1 - busy / (wall * workers))

    hours, idle = spent(1, 0.0)
    hours_shared, idle_shared = spent(IMAGES, MERGE)
    return {
        "workers": workers,
        "hours": hours,
        "idle": idle,
        "hours_shared": hours_shared,
        "idle_shared": idle_shared,
        "broadcast": VECTORS / FASTEST * math.ceil(math.log2(workers + 1)),
    }


def measure() -> list[dict[str, Any]]:
    """A row a number of workers."""
    return [run(workers) for workers in WORKERS]


COLUMNS = {
    "workers": "{workers}",
    "hours": "{hours:.3g}",
    "idle at the barrier": "{idle:.0%}",
    "hours, images shared": "{hours_shared:.3g}",
    "idle": "{idle_shared:.0%}",
    "broadcast, s": "{broadcast:.2f}",
}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table."""
    cells = ([shape.format(**row).replace("%", " %") for shape in COLUMNS.values()] for row in rows)
    return numbers(list(COLUMNS), cells)


def section() -> str:
    """The table, a picture, and what to build next."""
    rows = measure()
    told = {"idle": "whole evaluations", "idle_shared": "images shared out"}
    curves = {label: (WORKERS, [100 * row[key] for row in rows]) for key, label in told.items()}
    many = next(row for row in rows if row["workers"] == 64)
    idle, rest = f"{100 * many['idle']:.1f}", f"{100 * many['idle_shared']:.1f}"
    figure = lines(
        curves,
        title="How much of the workers' time does the generation barrier cost?",
        subtitle=f"64 workers: {100 * many['idle']:.0f} %, with images shared out {rest} %",
        x="workers",
        y="idle (%)",
        logarithmic=True,
    )
    return f"""## Past this machine: 1 to 256 workers, simulated

`{shown("scale.py")}`: the paper's hours on FoundationStereo and 4 GPUs;
new subsets a generation as Stage 1 proposes them on `bank`, CMA-ES populations of 13 or 14, evaluations
that differ by 5 %. The engines' own schedule shares images out. Broadcast of the task vectors,
{VECTORS / 2**30:.1f} GiB, is over 10 Gbit Ethernet, in a tree.

{picture(figure, "scale", "Idle share of workers against their number")}

{table(rows)}

At 64 workers the barrier idles {idle} % of the paper's search while evaluations stay whole, and {rest} % with
images shared out, which every engine does by itself."""


if __name__ == "__main__":
    answered(measure, table)
