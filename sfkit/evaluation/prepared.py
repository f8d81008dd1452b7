"""A benchmark made ready: images decoded and checked, masks decided, inputs made once for all evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfkit.architectures import InputConvention, PreparedPair
from sfkit.datasets import check_sample
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.pairs import Pair, Sample, StereoPair
from sfkit.errors import InputError
from sfkit.evaluation.metrics import ImageErrors, count_errors
from sfkit.evaluation.protocols import protocol
from sfkit.evaluation.regions import Regions

KEEP_BYTES = 2 << 30  # prepared inputs beyond this are made anew for every evaluation
REGION_BYTES = 88  # a pixel, at most: its ground truth, and where it lies in which region
LOOK_ROWS = 64  # rows of each pair that are looked at for doubts; all rows would cost as much as loading


class PreparedBenchmark:
    """Samples of a benchmark with the inputs one architecture makes of them.

    Everything an evaluation could trip over (a missing file, unequal sizes, no valid pixel, a missing
    mask) is met here, before the first network runs. Inputs are made when they are first asked for.

    Raises:
        InputError: as loading and :meth:`~sfkit.evaluation.protocols.Protocol.valid_mask` say.
    """

    def __init__(self, benchmark: Benchmark, inputs: InputConvention, thresholds: tuple[float, ...]) -> None:
        self.benchmark = benchmark
        self.inputs = inputs
        self.thresholds = thresholds
        self.rule = protocol(benchmark.protocol)
        self.samples: tuple[Sample, ...] = tuple(self._checked(pair) for pair in benchmark.pairs)
        total = sum(8 * 3 * sample.left.shape[0] * sample.left.shape[1] for sample in self.samples)
        self._keep = total <= KEEP_BYTES
        self._kept: dict[int, PreparedPair] = {}
        self._keep_regions = total // 24 * REGION_BYTES <= KEEP_BYTES
        self._regions: dict[int, Regions] = {}

    def __len__(self) -> int:
        return len(self.samples)

    def __iter__(self) -> Iterator[tuple[Sample, PreparedPair]]:
        for number, sample in enumerate(self.samples):
            yield sample, self.pair(number)

    def pair(self, number: int) -> PreparedPair:
        """The network's input for one pair."""
        if number in self._kept:
            return self._kept[number]
        sample = self.samples[number]
        made = self.inputs.prepare(sample.left, sample.right)
        if self._keep:
            self._kept[number] = made
        return made

    def errors(self, sample: Sample, prediction: NDArray[np.float32]) -> ImageErrors:
        """Sums and counts of one prediction (H, W) in pixels for one of :attr:`samples`."""
        regions = self._regions.get(id(sample))
        if regions is None:
            regions = self.rule.regions(sample, self.benchmark.family)
            if self._keep_regions and any(sample is own for own in self.samples):
                self._regions[id(sample)] = regions
        return count_errors(prediction, regions, thresholds=self.thresholds)

    def doubt(self) -> str | None:
        """One sentence where pairs look wrong, such as left and right exchanged; None where none does."""
        doubts = {sample.id: found for sample in self.samples if (found := _doubts(sample))}
        if not doubts:
            return None
        name, found = next(iter(doubts.items()))
        more = f" (like {len(doubts) - 1} of the other {len(self) - 1})" if len(doubts) > 1 else ""
        return (
            f"benchmark {self.benchmark.name!r}: pair {name!r} looks wrong{more}: {'; '.join(found)}; "
            "sfkit data check looks at every pixel"
        )

    def _checked(self, pair: Pair) -> Sample:
        sample = pair.load()
        try:
            self.rule.valid_mask(sample, self.benchmark.family)
        except InputError as error:
            truth = pair.disparity if isinstance(pair, StereoPair) else None
            raise InputError(f"{truth}: {error}" if truth else str(error)) from error
        return sample


def _doubts(sample: Sample) -> tuple[str, ...]:
    """What :mod:`~sfkit.datasets.check_sample` finds in evenly spread rows of a pair."""
    rows = slice(None, None, max(1, sample.size[0] // LOOK_ROWS))
    mask = None if sample.nonoccluded is None else sample.nonoccluded[rows]
    thin = replace(
        sample,
        left=sample.left[rows],
        right=sample.right[rows],
        disparity=sample.disparity[rows],
        nonoccluded=mask,
    )
    if not np.isfinite(thin.disparity).any():  # sparse ground truth between those rows says nothing
        return ()
    return (*check_sample.problems(thin), *check_sample.warnings(thin))
