"""Real checkpoints and pairs, which lie where SFKIT_REAL_DATA says: benchmarks, and folders for reports."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import numpy as np
from processes import folder_of

import sfkit
from sfkit.datasets import Benchmark, Sample
from sfkit.datasets.formats import write_png
from sfkit.datasets.pairs import Pair
from sfkit.datasets.training_sets import open_training_set
from sfkit.merging import Pool

DATA = "SFKIT_REAL_DATA"
POOL = Path(__file__).parents[1] / "tests" / "pools" / "anynet_real.toml"
CODINGS = {"motorcycle": "npz:arr_0", "cones": "png8:4", "reindeer": "png8:2"}
PAIRS = ("eth3d", "kitti2012", *CODINGS)
SEEN = "kitti2012"
"""Its pair belongs to the sources' training images."""
FRAMES = {"sceneflow": "SceneFlow", "instereo2k": "InStereo2K", "tartanair": "TartanAir"}
"""Training set -> the folder of its frames beside the real pairs."""
GUIDES = ("eth3d", "cones", "reindeer")
"""Pairs of three data sets: ETH3D, Middlebury 2003 and 2005."""
SIZE = 256, 512
"""Height and width in pixels that are cut from the middle of larger images: these reports cost minutes."""


def data() -> Path:
    """The folder of real data."""
    return folder_of(DATA)


@lru_cache
def opened() -> Pool:
    """Five real checkpoints."""
    return sfkit.open_pool(POOL)


@lru_cache
def evaluators() -> dict[str, sfkit.Evaluator]:
    """Every pair as a benchmark of its own, by name."""
    return {name: sfkit.Evaluator(opened(), benchmark) for name, benchmark in benchmarks().items()}


def benchmarks() -> dict[str, Benchmark]:
    """ETH3D's playground, KITTI 2012's first pair (the sources may have seen it), Middlebury's three."""
    found = {
        name: sfkit.open_benchmark(name, data() / name, protocol=protocol, metric="bad-1.0")
        for name, protocol in (("eth3d", "raft"), ("kitti2012", "all-valid"))
    }
    for name, coding in CODINGS.items():
        root = data() / "pairs" / name
        found[name] = sfkit.open_benchmark("pairs", root, coding=coding, metric="bad-1.0")
    return found


def frames(name: str) -> tuple[Pair, ...]:
    """The frames of one of :data:`FRAMES`."""
    return tuple(open_training_set(name, data() / "sources" / FRAMES[name], hold_out=False).pairs)


def window(sample: Sample, size: tuple[int, int]) -> Sample:
    """The middle of a pair, at most (height, width) pixels of it, the same in both views."""
    top, left = (max(0, whole - part) // 2 for whole, part in zip(sample.size, size, strict=True))
    cut = (slice(top, top + size[0]), slice(left, left + size[1]))
    arrays = {name: np.ascontiguousarray(array[cut]) for name, array in sample.arrays().items()}
    return Sample(id=sample.id, **arrays)


def gather(folder: Path) -> tuple[Path, Path]:
    """Copy the pairs, cut to :data:`SIZE`, each in a sub-folder with names in common use.

    Returns:
        The folder of :data:`GUIDES`, and that of Motorcycle and of frames of training sets that no source
        was tuned on.
    """
    found = {name: benchmark.pairs[0] for name, benchmark in benchmarks().items()}
    unseen = [(name, found[name]) for name in PAIRS if name not in (*GUIDES, SEEN)]
    unseen += [(f"{name}-{number}", pair) for name in FRAMES for number, pair in enumerate(frames(name))]
    guides = [(name, found[name]) for name in GUIDES]
    return _copied(folder / "three-data-sets", guides), _copied(folder / "elsewhere", unseen)


def _copied(folder: Path, pairs: Iterable[tuple[str, Pair]]) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    for name, pair in pairs:
        own = folder / name
        own.mkdir(parents=True)
        sample = window(pair.load(), SIZE)
        write_png(own / "left.png", sample.left[..., ::-1])  # OpenCV's order of colours
        write_png(own / "right.png", sample.right[..., ::-1])
        np.save(own / "disp.npy", sample.disparity)
    return folder
