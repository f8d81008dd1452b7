"""Coarse fingerprints of the rendered benchmarks: a check that a machine renders what was trained for.

Pixels may differ by rounding between machines, so a fingerprint holds block means: of both images in
grey levels, of the ground truth in tenths of a pixel, and the shares of known and of visible pixels.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfkit.bank.plan import BANK
from sfkit.bank.rendered import benchmark, benchmarks
from sfkit.datasets import Sample
from sfkit.files import write_text

BLOCKS = (6, 12)

Fingerprint = dict[str, list[int]]


def fingerprint(sample: Sample) -> Fingerprint:
    """The coarse content of a pair, whole numbers by what they tell of; -1 for a block without truth."""
    known = np.isfinite(sample.disparity)
    visible = known if sample.nonoccluded is None else sample.nonoccluded
    return {
        "left": _block_means(sample.left.mean(axis=2), 1.0),
        "right": _block_means(sample.right.mean(axis=2), 1.0),
        "disparity": _block_means(sample.disparity.astype(np.float64), 10.0),
        "shares": [round(1000 * float(known.mean())), round(1000 * float(visible.mean()))],
    }


def write_fingerprints(path: Path, names: Iterable[str] | None = None, *, of: str = BANK.name) -> None:
    """Render the benchmarks of a bank (all, or ``names``) and write their fingerprints, one pair a line."""
    chosen = benchmarks() if names is None else names
    samples = (sample for name in chosen for sample in benchmark(name, of=of).samples())
    lines = [f"{json.dumps(s.id)}: {json.dumps(fingerprint(s), separators=(',', ':'))}" for s in samples]
    write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")


def _block_means(values: NDArray[np.float64], scale: float) -> list[int]:
    """Means of BLOCKS equal blocks, row by row, over what is not NaN."""
    rows = np.array_split(values, BLOCKS[0], axis=0)
    blocks = [block for row in rows for block in np.array_split(row, BLOCKS[1], axis=1)]
    return [round(scale * float(np.nanmean(block))) if np.isfinite(block).any() else -1 for block in blocks]
