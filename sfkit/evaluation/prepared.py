"""A benchmark made ready: images decoded, normalised and padded, masks decided, once for all evaluations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfkit.architectures import InputConvention, PreparedPair
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.pairs import Sample
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.protocols import protocol

KEEP_BYTES = 2 << 30  # prepared inputs beyond this are made anew for every evaluation


class PreparedBenchmark:
    """Samples of a benchmark with the inputs one architecture makes of them.

    Everything an evaluation could trip over (a missing file, unequal sizes, no valid pixel, a missing
    mask) is met here, before the first network runs.

    Raises:
        InputError: as loading and :meth:`~sfkit.evaluation.protocols.Protocol.valid_mask` say.
    """

    def __init__(self, benchmark: Benchmark, inputs: InputConvention, thresholds: tuple[float, ...]) -> None:
        self.benchmark = benchmark
        self.inputs = inputs
        self.thresholds = thresholds
        self.rule = protocol(benchmark.protocol)
        self.samples: tuple[Sample, ...] = tuple(pair.load() for pair in benchmark.pairs)
        for sample in self.samples:
            self.rule.valid_mask(sample, benchmark.family)
        total = sum(8 * 3 * sample.left.shape[0] * sample.left.shape[1] for sample in self.samples)
        keep = total <= KEEP_BYTES
        self._kept = tuple(inputs.prepare(s.left, s.right) for s in self.samples) if keep else None

    def __len__(self) -> int:
        return len(self.samples)

    def __iter__(self) -> Iterator[tuple[Sample, PreparedPair]]:
        for number, sample in enumerate(self.samples):
            yield sample, self.pair(number)

    def pair(self, number: int) -> PreparedPair:
        """The network's input for one pair."""
        if self._kept is not None:
            return self._kept[number]
        sample = self.samples[number]
        return self.inputs.prepare(sample.left, sample.right)

    def errors(self, sample: Sample, prediction: NDArray[np.float32]) -> ImageErrors:
        """Sums and counts of one prediction (H, W) in pixels."""
        return self.rule.errors(prediction, sample, self.benchmark.family, thresholds=self.thresholds)
