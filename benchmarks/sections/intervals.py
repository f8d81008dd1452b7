"""How often intervals hold the truth, and how often a table claims what is not there: both simulated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from tabulated import markdown_lines

from sfkit.analysis.intervals import RunsOnImages, holm, paired_estimate

IMAGES = (3, 5, 8, 15, 27, 40)
DRAWS, RESAMPLES = 2000, 300
TABLES, PROBES = 4000, 44
Values = NDArray[np.float64]
POPULATIONS: dict[str, Callable[[np.random.Generator, tuple[int, ...]], Values]] = {
    "normal": lambda rng, shape: rng.normal(0.0, 1.0, shape),
    "heavy tails (t, 3 degrees)": lambda rng, shape: rng.standard_t(3, shape),
    "skewed (exponential)": lambda rng, shape: rng.exponential(1.0, shape) - 1.0,
}


Rows = list[tuple[object, ...]]


def measure() -> tuple[Rows, Rows, Rows]:
    """Simulate: intervals over images, intervals over images and seeds, and claims."""
    rows: Rows = []
    for name, draw in POPULATIONS.items():
        for kind, held in (("Student's t (sfkit)", _student), ("percentile bootstrap", _bootstrap)):
            rng = np.random.default_rng(5)
            shares = [held(draw(rng, (DRAWS, images)), rng) for images in IMAGES]
            rows.append((name, kind, *(f"{share:.3f}" for share in shares)))
    drawn: Rows = [
        (runs, images, f"{over:.3f}", f"{alone:.3f}")
        for runs, images in ((3, 8), (5, 8), (5, 27), (5, 40))
        for over, alone in (_seeds(runs, images),)
    ]
    return rows, drawn, [(images, *(f"{share:.3f}" for share in _null(images))) for images in (5, 8, 27)]


def section() -> str:
    """The three tables."""
    rows, drawn, claimed = measure()
    table = markdown_lines(("differences of images", "interval", *map(str, IMAGES)), rows)
    seeds = markdown_lines(("seeds", "images", "over images and seeds", "over images alone"), drawn)
    heads = ("images", "some claim, each tested alone", "some claim, corrected (Holm)")
    claims = markdown_lines(heads, claimed)
    return f"""## Do intervals hold what they promise?

Share of {DRAWS:,} simulated comparisons whose 95 % interval holds the true difference, by the number of
images:

{table}

Where a method draws at random, its runs differ too; here the spread between seeds is half of that between
images. The true difference is the method's, over all seeds and images:

{seeds}

Nulls: {TABLES:,} tables of {PROBES} networks that differ from their reference by chance alone, as
many as 11 sources probed in 4 blocks. Share of tables that claim at least one difference (0.05 has a
standard error of 0.003 in so many):

{claims}"""


def _student(rows: Values, _: np.random.Generator) -> float:
    zero = RunsOnImages(np.zeros((1, rows.shape[1])))
    ends = [paired_estimate([(RunsOnImages(row[None]), zero)]).interval() for row in rows]
    return float(np.mean([low <= 0.0 <= high for low, high in ends]))


def _bootstrap(rows: Values, rng: np.random.Generator) -> float:
    count = rows.shape[1]
    drawn = rows[:, rng.integers(0, count, (RESAMPLES, count))].mean(axis=2)
    low, high = np.percentile(drawn, [2.5, 97.5], axis=1)
    return float(np.mean((low <= 0.0) & (high >= 0.0)))


def _seeds(runs: int, images: int) -> tuple[float, float]:
    rng, held = np.random.default_rng(7), np.zeros(2)
    zero = RunsOnImages(np.zeros((1, images)))
    for _ in range(DRAWS):
        values = rng.normal(0.0, 0.5, (runs, 1)) + rng.normal(0.0, 1.0, images)
        values += rng.normal(0.0, 0.3, (runs, images))
        for place, one in enumerate((values, values.mean(axis=0)[None])):
            low, high = paired_estimate([(RunsOnImages(one), zero)]).interval()
            held[place] += low <= 0.0 <= high
    over, alone = held / DRAWS
    return float(over), float(alone)


def _null(images: int) -> tuple[float, float]:
    rng, claims = np.random.default_rng(8), np.zeros(2)
    for _ in range(TABLES):
        shared = rng.normal(0.0, 1.0, (1, images))
        found = [
            paired_estimate([(RunsOnImages(shared + rng.normal(0.0, 1.0, images)), RunsOnImages(shared))]).p
            for _ in range(PROBES)
        ]
        claims += (min(found) < 0.05, min(holm(found)) < 0.05)
    plain, corrected = claims / TABLES
    return float(plain), float(corrected)
