"""How well ``census``, which needs no ground truth, ranks networks: variants of it against the true error.

    python benchmarks/census.py --json

Real networks (with SFKIT_REAL_DATA): base and all merges of four AnyNet sources, five pairs, with and
without the propagation stage, and frames of training sets, bad-1.0. The embedded bank: its 11 sources and
subsets drawn at random, the first pairs of each of its four worlds, bad-3.0. A map is predicted once and
compared by every variant; nothing is kept.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import evidence_real
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import spearmanr

import sfkit
from sfkit import bank
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets import Benchmark, Sample, memory_benchmark
from sfkit.datasets.census import SCALES, CensusScale, CensusTarget
from sfkit.datasets.training_sets import open_training_set
from sfkit.merging import Pool, Recipe
from sfkit.merging.live import LiveModel

Map = NDArray[np.float32]
PLAIN = CensusScale(0.0)
FINE, COARSE = SCALES
SCALED: dict[str, tuple[CensusScale, ...]] = {
    "5 x 5, no smoothing": (PLAIN,),
    "7 x 9, no smoothing": (replace(PLAIN, window=(7, 9)),),
    "sigma 1.2": (FINE,),
    "sigma 3, every 2nd pixel": (COARSE,),
    "sigma 0 and 3": (PLAIN, COARSE),
    "sigma 1.2 and 3 (`census`)": SCALES,
    "sigma 1.2, 3 and 5": (*SCALES, CensusScale(5.0, step=3)),
}
DEFAULT = "sigma 1.2 and 3 (`census`)"
TRIMMED = "`census`, best 90 % of pixels"
SMOOTH = "`census` and smoothness"
VARIANTS = (*SCALED, TRIMMED, SMOOTH)
JUMP = 1.0  # pixels between neighbours; what the smoothness term counts, in percent of pixels
SMOOTHNESS = 0.1  # weight of that percentage


class Pair:
    """One pair as every variant sees it."""

    def __init__(self, sample: Sample) -> None:
        self.sample = sample
        self.targets = {
            name: CensusTarget(sample.left, sample.right, scales=scales) for name, scales in SCALED.items()
        }

    def scores(self, map_: Map, seconds: dict[str, float]) -> dict[str, float]:
        """Percent by each variant; CPU seconds are added up."""
        found = {}
        for name in VARIANTS:
            started = time.process_time()
            found[name] = self._score(name, map_)
            seconds[name] = seconds.get(name, 0.0) + time.process_time() - started
        return found

    def _score(self, name: str, map_: Map) -> float:
        if name in self.targets:
            return self.targets[name].residual(map_).score
        if name == SMOOTH:
            jumps = np.abs(np.diff(map_, axis=1)) > JUMP
            return self.targets[DEFAULT].residual(map_).score + SMOOTHNESS * 100.0 * float(jumps.mean())
        percent = self.targets[DEFAULT].map(map_)
        known = np.sort(percent[np.isfinite(percent)])
        return float(known[: round(0.9 * len(known))].mean())

    def truth(self, map_: Map, threshold: float) -> float:
        """Percent of the pixels with ground truth that are off by more."""
        known = np.isfinite(self.sample.disparity) & (self.sample.disparity > 0)
        return 100.0 * float((np.abs(map_ - self.sample.disparity)[known] > threshold).mean())


def table(
    pool: Pool, recipes: Mapping[str, Recipe], benchmark: Benchmark, threshold: float
) -> dict[str, Any]:
    """How each variant ranks the networks by their mean over pairs, what it picks, and what there is."""
    inputs, live = pool.architecture.inputs(pool.options), LiveModel(pool)
    pairs = [Pair(sample) for sample in benchmark.samples()]
    made = [inputs.prepare(pair.sample.left, pair.sample.right) for pair in pairs]
    scores: dict[str, list[float]] = {name: [] for name in VARIANTS}
    seconds: dict[str, float] = {"network": 0.0}
    truth = []
    for recipe in recipes.values():
        live.apply(recipe)
        rows, errors = [], []
        for pair, ready in zip(pairs, made, strict=True):
            started = time.process_time()
            with torch.inference_mode():
                map_ = ready.window.crop(live.disparity(ready.left, ready.right)).numpy().copy()
            seconds["network"] += time.process_time() - started
            rows.append(pair.scores(map_, seconds))
            errors.append(pair.truth(map_, threshold))
        truth.append(float(np.mean(errors)))
        for name in VARIANTS:
            scores[name].append(float(np.mean([row[name] for row in rows])))
    names = list(recipes)
    return {
        "benchmark": benchmark.name,
        "networks": len(names),
        "pairs": len(pairs),
        "best": min(truth),
        "uniform": truth[names.index("+".join(pool.names))],
        "variants": {
            name: {
                "correlation": float(spearmanr(truth, values).statistic),
                "picked": truth[int(np.argmin(values))],
                "cost": seconds[name] / seconds["network"],
            }
            for name, values in scores.items()
        },
    }


def real() -> Iterator[dict[str, Any]]:
    """Base and all merges of the real sources, with the propagation stage and without."""
    for spn in (True, False):
        spec = read_pool_spec(evidence_real.POOL)
        pool = sfkit.open_pool(replace(spec, options={"spn": spn}))
        for benchmark in evidence_real.benchmarks().values():
            yield {"kind": "real", "spn": spn, **table(pool, merges(pool), benchmark, 1.0)}


def merges(pool: Pool) -> dict[str, Recipe]:
    """Base, and every subset of the sources, by name."""
    subsets = [c for size in range(len(pool.names)) for c in itertools.combinations(pool.names, size + 1)]
    return {"base": pool.base_recipe(), **{"+".join(chosen): pool.equal(*chosen) for chosen in subsets}}


FRAMES = {"sceneflow": "SceneFlow", "instereo2k": "InStereo2K", "tartanair": "TartanAir"}
"""Training set -> the folder of its frames beside the real pairs."""


def frames() -> Iterator[dict[str, Any]]:
    """The same networks, with propagation, on frames that sources are commonly trained on."""
    pool = sfkit.open_pool(evidence_real.POOL)
    folder = Path(os.environ["SFKIT_REAL_DATA"]) / "sources"
    for name, place in FRAMES.items():
        found = open_training_set(name, folder / place, hold_out=False)
        yield {
            "kind": "frames",
            "spn": True,
            **table(pool, merges(pool), memory_benchmark(name, found.pairs), 1.0),
        }


def embedded(subsets: int, pairs: int) -> Iterator[dict[str, Any]]:
    """The bank's sources, all of them merged, and subsets drawn at random, on each of its worlds."""
    pool, rng = sfkit.open_pool("bank"), np.random.default_rng(0)
    chosen = [(name,) for name in pool.names] + [pool.names]
    while len(chosen) < subsets:
        kept = set(rng.permutation(len(pool.names))[: int(rng.integers(2, len(pool.names)))].tolist())
        drawn = tuple(name for number, name in enumerate(pool.names) if number in kept)
        chosen += [] if drawn in chosen else [drawn]
    recipes = {"+".join(names): pool.equal(*names) for names in chosen}
    for world in bank.benchmarks():
        benchmark = sfkit.open_benchmark(f"bank:{world}", pairs=pairs)
        yield {"kind": "bank", "spn": None, **table(pool, recipes, benchmark, 3.0)}


def measure(subsets: int, pairs: int, folder: Path) -> list[dict[str, Any]]:
    """One row a benchmark; those that a file in ``folder`` holds are not measured again."""
    torch.set_num_threads(1)
    parts: list[tuple[str, Callable[[], Iterator[dict[str, Any]]]]] = [
        (f"bank-{subsets}-{pairs}", lambda: embedded(subsets, pairs))
    ]
    if "SFKIT_REAL_DATA" in os.environ:
        parts = [("real", real), ("frames", frames), *parts]
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for name, part in parts:
        file = folder / f"{name}.json"
        if not file.is_file():
            file.write_text(json.dumps(list(part())))
        rows += json.loads(file.read_text())
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--subsets", type=int, default=60, help="of the bank")
    parser.add_argument("--pairs", type=int, default=8, help="of each of the bank's worlds")
    parser.add_argument("--folder", type=Path, default=Path("runs/census"), help="where results are kept")
    parser.add_argument("--json", action="store_true", help="print a JSON list of records")
    options = vars(parser.parse_args(arguments))
    as_json = options.pop("json")
    rows = measure(**options)
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        print(f"{row['benchmark']} ({row['networks']} networks), spn {row['spn']}: best {row['best']:.2f}")
        for name, found in row["variants"].items():
            print(
                f"  {name:32} {found['correlation']:5.2f}  picks {found['picked']:6.2f}  {found['cost']:.3f}"
            )


if __name__ == "__main__":
    main()
