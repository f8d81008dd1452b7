"""What DisparityCompare is tested on: a hand-made pair, and a tiny pool with a benchmark of two pairs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from sfkit_widgets.disparity_compare import DisparityCompare
from tiny import write_pairs, write_pool

from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.pair_maps import error_map
from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.merging import Pool, open_pool

HEIGHT, WIDTH = 24, 48
HOLE = 8  # columns at the left without ground truth
LUMP = (slice(6, 14), slice(30, 42))  # where network "lumpy" is 5 px off


def panels() -> DisparityPanels:
    """Truth is a ramp with a hole; one network is off by 0.5 px, one by 5 px in a lump, one is broken there.

    "lumpy" is exact elsewhere; its worst pixel is (35, 10) with an error of 7 px.
    """
    truth = np.broadcast_to(np.linspace(2, 20, WIDTH, dtype=np.float32), (HEIGHT, WIDTH)).copy()
    truth[:, :HOLE] = np.nan
    shift = np.nan_to_num(truth, nan=3.0) + np.float32(0.5)
    lumpy = np.nan_to_num(truth, nan=9.0)
    lumpy[LUMP] += 5.0
    lumpy[10, 35] += 2.0
    broken = np.nan_to_num(truth, nan=9.0)
    broken[0, -1] = np.nan
    scores = {"shift": 0.0, "lumpy": 10.0, "<i>broken</i>": 100.0}
    maps = zip(scores, (shift, lumpy, broken), strict=True)
    networks = [NetworkMaps(n, m, error_map(m, truth), {"bad-1.0": scores[n]}) for n, m in maps]
    left = np.full((HEIGHT, WIDTH, 3), (200, 60, 20), np.uint8)
    return DisparityPanels(
        "world", "all-valid", "ramp", left, truth, tuple(networks), (2.0, 20.0), threshold=1.0
    )


def world(folder: Path) -> tuple[Pool, Benchmark]:
    """A tiny pool of three sources and two pairs."""
    pool = open_pool(write_pool(folder / "pool"))
    return pool, open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0")


def widget(folder: Path, **settings: object) -> DisparityCompare:
    """Three recipes of the tiny pool on its pairs."""
    pool, benchmark = world(folder)
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform(), "a alone": pool.equal("a")}
    return DisparityCompare(pool, recipes, benchmark, **settings)  # type: ignore[arg-type]
