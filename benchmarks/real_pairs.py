"""The real pairs in two folders that a report opens: what guides, and what nothing was tuned on."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import evidence_real
import numpy as np
from census import FRAMES
from stage2_worlds import window

from sfkit.datasets.formats import write_png
from sfkit.datasets.pairs import Pair
from sfkit.datasets.training_sets import open_training_set

GUIDES = ("eth3d", "cones", "reindeer")
"""Pairs of three data sets: ETH3D, Middlebury 2003 and 2005."""
SIZE = 256, 512
"""Height and width in pixels that are cut from the middle of larger images: these reports cost minutes."""
SEEN = "kitti2012"
"""Its pair belongs to the sources' training images."""


def gather(folder: Path) -> tuple[Path, Path]:
    """Copy the pairs, cut to :data:`SIZE`, each in a sub-folder with names in common use.

    Returns:
        The folder of :data:`GUIDES`, and that of Motorcycle and of frames of training sets that no source
        was tuned on.
    """
    found = evidence_real.benchmarks()
    root = Path(os.environ["SFKIT_REAL_DATA"]) / "sources"
    frames = {
        f"{name}-{number}": pair
        for name, place in FRAMES.items()
        for number, pair in enumerate(open_training_set(name, root / place, hold_out=False).pairs)
    }
    unseen = {name: found[name].pairs[0] for name in evidence_real.PAIRS if name not in (*GUIDES, SEEN)}
    guides = {name: found[name].pairs[0] for name in GUIDES}
    return _copied(folder / "three-data-sets", guides.items()), _copied(
        folder / "elsewhere", [*unseen.items(), *frames.items()]
    )


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
