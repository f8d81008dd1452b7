"""The picture at the top of the README: one pair before and after, from the recipe that ``make demo`` found.

    .venv/bin/python docs/before_after.py runs/demo/recipe.json

The pair is not chosen by its looks: of a world that guided nothing it is the one of median gain.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from bank_pictures import colours
from numpy.typing import NDArray

import sfkit
from sfkit.bank import worlds
from sfkit.bank.plan import MAIN
from sfkit.datasets import Sample
from sfkit.merging.origin import read_recipe

PAIRS = 11
THRESHOLD = 3.0  # pixels; the bank's bad-3.0
OUT = Path(__file__).parent / "images" / "before_after.webp"
Map = NDArray[np.float32]


def error_map(prediction: Map, sample: Sample) -> NDArray[np.uint8]:
    """Errors (H, W, 3): black at 0 px, white at 6 px and beyond, blue where the truth is unknown."""
    error = np.abs(prediction - sample.disparity)
    grey = np.rint(255 * np.clip(np.nan_to_num(error) / 6.0, 0.0, 1.0)).astype(np.uint8)
    painted = np.where(np.isnan(error)[..., None], (30, 30, 90), np.repeat(grey[..., None], 3, 2))
    return painted.astype(np.uint8)


def bad(prediction: Map, sample: Sample) -> float:
    """Percent of known pixels that are wrong by more than three."""
    known = np.isfinite(sample.disparity)
    return 100.0 * float((np.abs(prediction - sample.disparity)[known] > THRESHOLD).mean())


def main(recipe: Path) -> None:
    """Predict, choose the pair, write the picture and say its scores."""
    pool = sfkit.open_pool(MAIN.name)
    _, (world, *_) = worlds(MAIN.name, None)
    benchmark = sfkit.open_benchmark(str(world)).first(PAIRS)
    samples = [pair.load() for pair in benchmark.pairs]
    inputs = sfkit.Evaluator(pool, benchmark).prepared.inputs
    prepared = [inputs.prepare(sample.left, sample.right) for sample in samples]
    models = [sfkit.Compute().model(pool, chosen) for chosen in (pool.uniform(), read_recipe(recipe))]
    maps = [[p.window.crop(m.disparity(p.left, p.right)).numpy() for m in models] for p in prepared]
    scores = [[bad(one, sample) for one in pair] for pair, sample in zip(maps, samples, strict=True)]
    chosen = sorted(range(len(samples)), key=lambda n: scores[n][0] - scores[n][1])[len(samples) // 2]
    sample, (before, after) = samples[chosen], maps[chosen]
    largest = float(np.nanmax(sample.disparity))
    rows = [
        np.hstack([sample.left, colours(before, largest), colours(after, largest)]),
        np.hstack([colours(sample.disparity, largest), error_map(before, sample), error_map(after, sample)]),
    ]
    picture = np.vstack(rows)
    if not cv2.imwrite(str(OUT), picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 85]):
        raise OSError(f"{OUT}: cannot be written")
    first, second = scores[chosen]
    print(f"{OUT.name}: pair {chosen} of {world}, bad-3.0 {first:.1f} % and {second:.1f} %")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/demo/recipe.json"))
