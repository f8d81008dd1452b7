"""How well ``census``, which needs no ground truth, ranks networks: variants of it against the true error.

    python benchmarks/census.py --json

Real networks (with SFKIT_REAL_DATA): base and all merges of four AnyNet sources, five pairs, with and
without the propagation stage, and frames of training sets, bad-1.0. The embedded bank: its 11 sources and
subsets drawn at random, the first pairs of each of its four worlds, bad-3.0. A map, and that of the right
view, is predicted once and compared by every variant. Results are kept: started again, only variants that
they lack are measured.
"""

from __future__ import annotations

import itertools
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import evidence_real
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import spearmanr
from stages import answered

import sfkit
from sfkit import bank
from sfkit.architectures.inputs import PreparedPair
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets import Benchmark, Sample, memory_benchmark
from sfkit.datasets.census import CHANCE, SCALES, CensusScale, CensusTarget
from sfkit.datasets.training_sets import open_training_set
from sfkit.evaluation.metrics import bad
from sfkit.evaluation.self_check import consistency
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
OCCLUDED = {"`census`, occluded pixels left out": 0.0, "`census`, occluded pixels by a quarter": 0.25}
"""Variant -> the weight of a pixel that the left-right check finds occluded; it needs a second pass."""
ONE_PASS = (*SCALED, TRIMMED, SMOOTH)
VARIANTS = (*ONE_PASS, *OCCLUDED)
FEWER = (24, 4)  # networks, and pairs of a world, for what needs two passes
JUMP = 1.0  # pixels between neighbours; what the smoothness term counts, in percent of pixels
SMOOTHNESS = 0.1  # weight of that percentage


class CensusPair:
    """One pair as every variant sees it."""

    def __init__(self, sample: Sample, variants: Sequence[str]) -> None:
        self.sample = sample
        self.variants = variants
        self.targets = {
            name: CensusTarget(sample.left, sample.right, scales=scales)
            for name, scales in SCALED.items()
            if name in (*variants, DEFAULT)
        }

    def scores(self, map_: Map, of_right: Map, seconds: dict[str, float]) -> dict[str, float]:
        """Percent by each variant; CPU seconds are added up."""
        found = {}
        for name in self.variants:
            started = time.process_time()
            found[name] = self._score(name, map_, of_right)
            seconds[name] = seconds.get(name, 0.0) + time.process_time() - started
        return found

    def _score(self, name: str, map_: Map, of_right: Map) -> float:
        if name in self.targets:
            return self.targets[name].residual(map_).score
        if name in OCCLUDED:
            return self._weighted(map_, of_right, OCCLUDED[name])
        if name == SMOOTH:
            jumps = np.abs(np.diff(map_, axis=1)) > JUMP
            return self.targets[DEFAULT].residual(map_).score + SMOOTHNESS * 100.0 * float(jumps.mean())
        percent = self.targets[DEFAULT].map(map_)
        known = np.sort(percent[np.isfinite(percent)])
        return float(known[: round(0.9 * len(known))].mean())

    def _weighted(self, map_: Map, of_right: Map, occluded: float) -> float:
        """The mean over pixels, of which those that the two views disagree on have another weight than 1."""
        percent = self.targets[DEFAULT].map(map_)
        agree, _ = consistency(map_, of_right)
        weights = np.where(agree, 1.0, occluded)[np.isfinite(percent)]
        known = percent[np.isfinite(percent)]
        return float(np.average(known, weights=weights)) if weights.any() else CHANCE

    def truth(self, map_: Map, threshold: float) -> float:
        """Percent of the pixels with ground truth that are off by more."""
        return bad(map_, self.sample.disparity, threshold)


def table(
    pool: Pool,
    recipes: Mapping[str, Recipe],
    benchmark: Benchmark,
    threshold: float,
    variants: Sequence[str] = VARIANTS,
) -> dict[str, Any]:
    """How each variant ranks the networks by their mean over pairs, what it picks, and what there is."""
    inputs, live = pool.architecture.inputs(pool.options), LiveModel(pool)
    pairs = [CensusPair(sample, variants) for sample in benchmark.samples()]
    made = [inputs.prepare(pair.sample.left, pair.sample.right) for pair in pairs]
    mirrored = [inputs.prepare(*_mirrored(pair.sample)) for pair in pairs]
    scores: dict[str, list[float]] = {name: [] for name in variants}
    seconds: dict[str, float] = {"network": 0.0}
    truth, twice = [], [name for name in variants if name in OCCLUDED]
    for recipe in recipes.values():
        live.apply(recipe)
        rows, errors = [], []
        for pair, ready, other in zip(pairs, made, mirrored, strict=True):
            map_, took = _predicted(live, ready)
            of_right, again = _predicted(live, other) if twice else (map_, 0.0)
            seconds["network"] += took
            for name in twice:
                seconds[name] = seconds.get(name, 0.0) + again
            rows.append(pair.scores(map_, of_right[:, ::-1], seconds))
            errors.append(pair.truth(map_, threshold))
        truth.append(float(np.mean(errors)))
        for name in variants:
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


def _predicted(live: LiveModel, pair: PreparedPair) -> tuple[Map, float]:
    """One disparity map (H, W) in pixels, and the CPU seconds of the pass."""
    started = time.process_time()
    with torch.inference_mode():
        map_ = pair.window.crop(live.disparity(pair.left, pair.right)).numpy().copy()
    return map_, time.process_time() - started


def _mirrored(sample: Sample) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The pair whose left view is the mirrored right one."""
    return np.ascontiguousarray(sample.right[:, ::-1]), np.ascontiguousarray(sample.left[:, ::-1])


class CensusTask(NamedTuple):
    """Networks of one pool on one benchmark."""

    kind: str
    spn: bool | None
    pool: Pool
    recipes: Mapping[str, Recipe]
    benchmark: Benchmark
    threshold: float
    variants: Sequence[str] = VARIANTS

    @property
    def file(self) -> str:
        """Where its row is kept."""
        parts = (self.kind, *(("without",) if self.spn is False else ()), self.benchmark.name)
        name = "-".join(parts).replace(", ", "-").replace(" ", "-")
        return f"{name}-{len(self.recipes)}-{len(self.benchmark)}.json"

    def row(self, variants: Sequence[str]) -> dict[str, Any]:
        """What :func:`table` says of some variants."""
        found = table(self.pool, self.recipes, self.benchmark, self.threshold, variants)
        return {"kind": self.kind, "spn": self.spn, **found}


def real() -> Iterator[CensusTask]:
    """Base and all merges of the real sources, with the propagation stage and without."""
    for spn in (True, False):
        spec = read_pool_spec(evidence_real.POOL)
        pool = sfkit.open_pool(replace(spec, options={"spn": spn}))
        for benchmark in evidence_real.benchmarks().values():
            yield CensusTask("real", spn, pool, merges(pool), benchmark, 1.0)


def merges(pool: Pool) -> dict[str, Recipe]:
    """Base, and every subset of the sources, by name."""
    subsets = [c for size in range(len(pool.names)) for c in itertools.combinations(pool.names, size + 1)]
    return {"base": pool.base_recipe(), **{"+".join(chosen): pool.equal(*chosen) for chosen in subsets}}


FRAMES = {"sceneflow": "SceneFlow", "instereo2k": "InStereo2K", "tartanair": "TartanAir"}
"""Training set -> the folder of its frames beside the real pairs."""


def frames() -> Iterator[CensusTask]:
    """The same networks, with propagation, on frames that sources are commonly trained on."""
    pool = sfkit.open_pool(evidence_real.POOL)
    folder = Path(os.environ["SFKIT_REAL_DATA"]) / "sources"
    for name, place in FRAMES.items():
        found = open_training_set(name, folder / place, hold_out=False)
        benchmark = memory_benchmark(name, found.pairs)
        yield CensusTask("frames", True, pool, merges(pool), benchmark, 1.0)


def embedded(subsets: int, pairs: int) -> Iterator[CensusTask]:
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
        yield CensusTask("bank", None, pool, recipes, benchmark, 3.0, ONE_PASS)
    few, pairs = FEWER
    chosen_few = dict(itertools.islice(recipes.items(), few))
    for world in bank.benchmarks():
        benchmark = sfkit.open_benchmark(f"bank:{world}", pairs=pairs)
        yield CensusTask("bank, two passes", None, pool, chosen_few, benchmark, 3.0, (DEFAULT, *OCCLUDED))


def measure(subsets: int, pairs: int, folder: Path) -> list[dict[str, Any]]:
    """One row a benchmark; variants that a file in ``folder`` holds are not measured again."""
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    outside = (real(), frames()) if "SFKIT_REAL_DATA" in os.environ else ()
    rows: list[dict[str, Any]] = []
    for task in itertools.chain(*outside, embedded(subsets, pairs)):
        file = folder / task.file
        row = json.loads(file.read_text()) if file.is_file() else {"variants": {}}
        if lacking := [one for one in task.variants if one not in row["variants"]]:
            made = task.row(lacking)
            row = made | {"variants": row["variants"] | made["variants"]}
            file.write_text(json.dumps(row))
        rows.append(row)
    return rows


def text(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as text."""
    lines = []
    for row in rows:
        about = f"{row['benchmark']} ({row['networks']} networks), spn {row['spn']}"
        lines.append(f"{about}: best {row['best']:.2f}")
        for name, found in row["variants"].items():
            picked, cost = found["picked"], found["cost"]
            lines.append(f"  {name:32} {found['correlation']:5.2f}  picks {picked:6.2f}  {cost:.3f}")
    return "\n".join(lines)


OPTIONS = {"subsets": 60, "pairs": 8, "folder": Path("runs/census")}
"""Of the command line: of the bank, of each of its worlds, and where results are kept."""

if __name__ == "__main__":
    answered(__doc__, measure, OPTIONS, text)
