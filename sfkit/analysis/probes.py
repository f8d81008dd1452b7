"""Block probes: which source does each block prefer, when all other blocks stay as they are?

The paper's "module-level knowledge specialization": one block follows a single source while the rest is
the subset's mean. What a block prefers is measured one block at a time; searches find what blocks
prefer together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.analysis.measured import Measured, measure_with
from sfkit.analysis.paired import Difference, corrected, paired_difference
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.table import ProgressCallback
from sfkit.merging.recipe import Recipe

MEAN = "mean of the subset"


@dataclass(frozen=True, eq=False)
class BlockProbes:
    """Every block with every source alone, against the mean of the subset.

    Attributes:
        blocks: B names.
        sources: E names, the subset.
        benchmark: where the probes were scored.
        metric: such as ``bad-1.0``.
        unit: ``%`` or ``px``.
        validation: True where the benchmark guided a search.
        mean: score of the subset's equal-weight mean.
        differences: B rows of E differences of a probe's score to ``mean``; negative is better.
    """

    blocks: tuple[str, ...]
    sources: tuple[str, ...]
    benchmark: str
    metric: str
    unit: str
    validation: bool
    mean: float
    differences: tuple[tuple[Difference, ...], ...]

    @property
    def values(self) -> NDArray[np.float64]:
        """(B, E) differences to the mean's score; NaN where a probe failed."""
        return np.array([[difference.value for difference in row] for row in self.differences])

    @property
    def noise(self) -> NDArray[np.bool_]:
        """(B, E) True where a difference is within the noise of all probes, or has no interval."""
        return np.array([[not d.word.beyond_noise for d in row] for row in self.differences])

    @property
    def preferred(self) -> dict[str, str | None]:
        """Block -> the source that helps it most beyond the noise of all probes; None where none does."""
        chosen: dict[str, str | None] = {}
        for block, values, noise in zip(self.blocks, self.values, self.noise, strict=True):
            # "Not below 0" is true of NaN as well.
            able = np.where(noise | ~(values < 0.0), np.inf, values)
            best = int(able.argmin())
            chosen[block] = self.sources[best] if np.isfinite(able[best]) else None
        return chosen

    def table(self) -> pd.DataFrame:
        """A row a block, a column a source: the difference to the mean's score."""
        return pd.DataFrame(self.values, index=pd.Index(self.blocks, name="block"), columns=[*self.sources])


def probe_recipes(subset: Iterable[str], blocks: Iterable[str]) -> dict[tuple[str, str], Recipe]:
    """(block, source) -> the mean of the subset, but for that block, which follows that source alone.

    Parameters outside every block follow the first block.

    Raises:
        InputError: fewer than two sources.
    """
    sources, names = tuple(subset), tuple(blocks)
    if len(sources) < 2:
        raise InputError(f"probes: found the subset {list(sources)}, expected at least two sources")
    mean = (1.0 / len(sources),) * len(sources)
    recipes = {}
    for block in names:
        for source in sources:
            alone = tuple(float(name == source) for name in sources)
            rows = tuple(alone if name == block else mean for name in names)
            recipes[block, source] = Recipe(sources, names, rows, (1.0,) * len(names))
    return recipes


def block_probes(
    evaluator: Evaluator,
    subset: Iterable[str],
    *,
    validation: bool = False,
    progress: ProgressCallback | None = None,
) -> BlockProbes:
    """Score all B x E probes and the subset's mean on one benchmark.

    Args:
        evaluator: of the benchmark.
        subset: sources to probe, at least two.
        validation: whether the benchmark guided a search.
        progress: called for each evaluation when it is done.

    Raises:
        InputError: fewer than two sources, or an unknown one.
    """
    pool = evaluator.pool
    sources = pool.subset(subset)
    probes = probe_recipes(sources, pool.blocks)
    named = {f"{block}: {source}": recipe for (block, source), recipe in probes.items()}
    guide = (evaluator.benchmark.name,) if validation else ()
    (one,) = measure_with(
        [evaluator], {MEAN: pool.equal(*sources), **named}, validation=guide, progress=progress
    )
    return _probes(one, pool.blocks, sources)


def _probes(one: Measured, blocks: tuple[str, ...], sources: tuple[str, ...]) -> BlockProbes:
    found = [paired_difference(one, f"{block}: {source}", MEAN) for block in blocks for source in sources]
    # B x E probes look for a preference at once: by chance alone some of them would find one.
    cells, width = corrected(found), len(sources)
    differences = tuple(cells[row * width : (row + 1) * width] for row in range(len(blocks)))
    return BlockProbes(
        blocks, sources, one.benchmark, one.metric, one.unit, one.validation, one.score(MEAN), differences
    )
