"""Which sources' data look like the target? Subsets by similarity, as the paper's section V-E tries them.

The paper names three cues and gives no formula. Here each cue describes a data set by the mean and the
variance of some channels over all positions, and two data sets are as far apart as two Gaussians of
independent channels (Fréchet distance; Heusel et al., NeurIPS 2017, with diagonal covariances):

- ``feature``: the base network's outputs of one block, such as the backbone, on left and right images;
- ``rgb``: colours of the left images;
- ``disparity``: what is left after warping the right image by the base's predicted disparity (absolute
  differences by colour), and that disparity in percent of the image's width. No ground truth is used.

Channels are divided by their standard deviation over all data sets, so that none rules by its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.analysis.features import BlockOutputs, block_modules
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.compute import HERE, Compute
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

Values = NDArray[np.float64]
CUES = ("feature", "rgb", "disparity")


@dataclass(frozen=True, eq=False)
class DataSimilarity:
    """Distances between the data of E sources and T targets by one cue.

    Attributes:
        cue: ``feature``, ``rgb`` or ``disparity``.
        sources: E names.
        targets: T names.
        distances: (E, T), 0 = alike; channels are in standard deviations over all data sets.
    """

    cue: str
    sources: tuple[str, ...]
    targets: tuple[str, ...]
    distances: Values

    def subset(self, target: str, size: int) -> tuple[str, ...]:
        """The ``size`` sources nearest to a target, nearest first; ties in the sources' order.

        Raises:
            InputError: an unknown target, or a size that is not between 1 and E.
        """
        ensure_known("target", target, self.targets)
        if not 1 <= size <= len(self.sources):
            raise InputError(f"similarity: found size {size}, expected 1 to {len(self.sources)} sources")
        order = np.argsort(self.distances[:, self.targets.index(target)], kind="stable")
        return tuple(self.sources[n] for n in order[:size])

    def table(self) -> pd.DataFrame:
        """A row a source, a column a target."""
        return pd.DataFrame(
            self.distances, index=pd.Index(self.sources, name="source"), columns=[*self.targets]
        )


def data_similarity(
    pool: Pool,
    sources: Mapping[str, Benchmark],
    targets: Sequence[Benchmark],
    cue: str,
    *,
    block: str = "backbone",
    compute: Compute = HERE,
) -> DataSimilarity:
    """Compare the data of each source with targets; a few pairs a data set are enough.

    Args:
        pool: whose base looks at the images, for ``feature`` and ``disparity``.
        sources: source name -> pairs of the data it was fine-tuned on, such as ``sfkit.bank.held_out``.
        targets: benchmarks to be good on; only their images are looked at.
        cue: ``feature``, ``rgb`` or ``disparity``.
        block: whose outputs are the features.
        compute: where and how the base runs, in this process.

    Raises:
        InputError: an unknown cue, source or block, a block without an output, or no data.
    """
    ensure_known("cue", cue, CUES)
    names = pool.subset(sources)
    if not names or not targets:
        raise InputError(
            f"similarity: found data of {len(names)} sources and {len(targets)} targets, expected some"
        )
    describe = _rgb if cue == "rgb" else _with_network(pool, cue, block, compute)
    moments = [_moments(describe, each) for each in (*(sources[name] for name in names), *targets)]
    means, variances = (np.stack(part) for part in zip(*moments, strict=True))
    # All data sets in one call, for one scale; sources against targets is a corner of it.
    distances = frechet(means, variances)[: len(names), len(names) :]
    return DataSimilarity(cue, names, tuple(target.name for target in targets), distances)


def similarity_recipes(pool: Pool, similarities: Iterable[DataSimilarity], size: int) -> dict[str, Recipe]:
    """``cue to target`` -> the equal-weight merge of the sources nearest to it, as in the paper's table.

    Raises:
        InputError: a size that is not between 1 and the number of sources.
    """
    return {
        f"{similarity.cue} to {target}": pool.equal(*similarity.subset(target, size))
        for similarity in similarities
        for target in similarity.targets
    }


def frechet(means: Values, variances: Values) -> Values:
    """(D, D) Fréchet distances between D Gaussians of C independent channels, (D, C) each.

    The channels' scale is divided out first: sqrt of their variance over all D data sets together.
    """
    # The variance over all data sets together: that within them and that between them.
    whole = variances.mean(axis=0) + means.var(axis=0)
    scale = np.sqrt(np.where(whole > 0.0, whole, 1.0))
    means, deviations = means / scale, np.sqrt(variances) / scale
    squared = sum(np.square(v[:, None] - v[None]).sum(axis=2) for v in (means, deviations))
    return np.asarray(np.sqrt(squared))


Moments = tuple[Values, Values]
"""(C,) means of the channels and of their squares over all positions."""


def _moments(describe: Callable[[Sample], Moments], benchmark: Benchmark) -> Moments:
    """Mean and variance (C,) of each channel over a data set; every pair weighs the same."""
    parts = [describe(sample) for sample in benchmark.samples()]
    mean, square = (np.mean([part[n] for part in parts], axis=0) for n in (0, 1))
    # Rounding can carry a variance of nearly nothing below 0.
    return mean, np.maximum(square - np.square(mean), 0.0)


def _over_positions(values: Values) -> Moments:
    """The moments of (positions, C) values."""
    return values.mean(axis=0), np.square(values).mean(axis=0)


def _rgb(sample: Sample) -> Moments:
    return _over_positions(sample.left.reshape(-1, 3).astype(np.float64))


def _with_network(pool: Pool, cue: str, block: str, compute: Compute) -> Callable[[Sample], Moments]:
    model = compute.model(pool)
    inputs = pool.architecture.inputs(pool.options)
    modules = block_modules(model.network, pool.partition, block) if cue == "feature" else {}

    def features(sample: Sample) -> Moments:
        pair = inputs.prepare(sample.left, sample.right)
        with BlockOutputs(modules, size=(pair.left.shape[-2], pair.left.shape[-1])) as outputs:
            model.disparity(pair.left, pair.right)
        return outputs.moments()

    def residual(sample: Sample) -> Moments:
        pair = inputs.prepare(sample.left, sample.right)
        disparity = pair.window.crop(model.disparity(pair.left, pair.right)).numpy()
        return _over_positions(warping_residual(sample, disparity))

    return residual if cue == "disparity" else features


def warping_residual(sample: Sample, disparity: NDArray[np.float32]) -> Values:
    """(H * W, 4): absolute colour differences to the warped right image, and disparity in % of the width.

    ``disparity`` (H, W) in pixels: left pixel x shows what right pixel x - d shows. Values that are not
    finite count as 0.
    """
    height, width = disparity.shape
    rows, columns = np.indices((height, width), dtype=np.float32)
    # There is no colour to fetch at a place that is not finite.
    shown = np.nan_to_num(disparity, nan=0.0, posinf=0.0, neginf=0.0)
    # Beyond the image there is nothing to compare with: its edge goes on.
    warped = cv2.remap(sample.right, columns - shown, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    differences = np.abs(sample.left.astype(np.float64) - warped.astype(np.float64)).reshape(-1, 3)
    return np.hstack([differences, 100.0 * shown.reshape(-1, 1).astype(np.float64) / width])
