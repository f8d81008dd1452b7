"""A benchmark made ready: images decoded and checked, masks decided, inputs made once for all evaluations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfkit.architectures import InputConvention, PreparedPair
from sfkit.datasets import check_sample
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Count, Mask, Metric
from sfkit.datasets.pairs import MemoryPair, Pair, Sample, StereoPair, is_labelled
from sfkit.errors import InputError
from sfkit.evaluation.metrics import ImageErrors, Quantities, count_errors
from sfkit.evaluation.regions import Regions, regions_of

KEEP_BYTES = 2 << 30  # prepared inputs beyond this are made anew for every evaluation
REGION_BYTES = 88  # a pixel, at most: its ground truth, and where it lies in which region
LOOK_PIXELS = 2000  # of each pair that are compared for doubts; more would cost as much as loading


class PreparedBenchmark:
    """Samples of a benchmark with the inputs one architecture makes of them.

    Everything an evaluation could trip over (a missing file, unequal sizes, no valid pixel, a missing
    mask) is met here, before the first network runs. Inputs are made when they are first asked for.

    Raises:
        InputError: as loading and :meth:`~sfkit.datasets.protocols.Rule.valid_mask` say.

    Attributes:
        samples: the loaded pairs, in the benchmark's order.
        valid: of each pair, the mask (H, W) of the pixels that count.
        fingerprint: of the benchmark's content as it was read.
    """

    def __init__(self, benchmark: Benchmark, inputs: InputConvention, quantities: Quantities) -> None:
        # The caller's arrays may change later, and would no longer be what the fingerprint says.
        own = (pair.frozen() if isinstance(pair, MemoryPair) else pair for pair in benchmark.pairs)
        self.benchmark = benchmark = replace(benchmark, pairs=tuple(own))
        self.fingerprint = benchmark.fingerprint()
        self.inputs = inputs
        self.quantities = quantities
        checked = [self._checked(pair) for pair in benchmark.pairs]
        self.samples: tuple[Sample, ...] = tuple(sample for sample, _ in checked)
        self.valid: tuple[Mask, ...] = tuple(mask for _, mask in checked)
        # A file may have been written while the images were decoded.
        self.ensure_unchanged()
        # Two views of three float32 channels; padding hardly matters here.
        total = sum(8 * 3 * sample.left.shape[0] * sample.left.shape[1] for sample in self.samples)
        self._keep = total <= KEEP_BYTES
        self._kept: dict[int, PreparedPair] = {}
        # 24 bytes of input a pixel: this is the number of pixels.
        self._keep_regions = total // 24 * REGION_BYTES <= KEEP_BYTES
        self._regions: dict[int, Regions] = {}
        self._counts: dict[tuple[int, str], tuple[tuple[Metric, Count], ...]] = {}

    def __len__(self) -> int:
        return len(self.samples)

    def __iter__(self) -> Iterator[tuple[Sample, PreparedPair]]:
        for number, sample in enumerate(self.samples):
            yield sample, self.pair(number)

    def ensure_unchanged(self) -> None:
        """Refuse files that are not what was read when this was made.

        Raises:
            InputError: a pair's file has changed.
        """
        if self.benchmark.fingerprint() != self.fingerprint:
            raise InputError(
                f"benchmark {self.benchmark.name!r}: a file of its pairs has changed since it was read, "
                "expected files that stay as they are: make the evaluator again"
            )

    def pair(self, number: int) -> PreparedPair:
        """The network's input for one pair."""
        if number in self._kept:
            return self._kept[number]
        sample = self.samples[number]
        made = self.inputs.prepare(sample.left, sample.right)
        if self._keep:
            self._kept[number] = made
        return made

    def truth(self, number: int) -> NDArray[np.float32]:
        """(H, W) ground truth of one pair in pixels, NaN where it does not count."""
        return np.where(self.valid[number], self.samples[number].disparity, np.float32(np.nan))

    def errors(self, number: int, prediction: NDArray[np.float32], device: str = "cpu") -> ImageErrors:
        """Sums and counts of one prediction (H, W) in pixels for the pair with that number.

        Metrics that can do so count on ``device``.
        """
        errors = count_errors(prediction, self._sorted(number), thresholds=self.quantities.thresholds)
        own = {metric.name: count(prediction) for metric, count in self._counting(number, device)}
        for name, ratio in own.items():
            if any(map(math.isnan, ratio)):
                raise InputError(
                    f"image {errors.id!r}: metric {name} counted {ratio}, expected numbers: a prediction "
                    "that is not finite gets the worst value there is"
                )
        return replace(errors, own=own)

    def _sorted(self, number: int) -> Regions:
        """A pair's ground truth by region: the same for every prediction."""
        if number in self._regions:
            return self._regions[number]
        made = regions_of(self.samples[number], self.valid[number], self.benchmark.rule)
        if self._keep_regions:
            self._regions[number] = made
        return made

    def _counting(self, number: int, device: str) -> tuple[tuple[Metric, Count], ...]:
        """What counts the quantities of the metrics that have some of their own, made once a pair as well."""
        if (number, device) in self._counts:
            return self._counts[number, device]
        sample, mask = self.samples[number], self.valid[number]
        counters = ((metric, metric.counter(sample, mask, device)) for metric in self.quantities.own)
        made = tuple((metric, count) for metric, count in counters if count is not None)
        if self._keep_regions:
            self._counts[number, device] = made
        return made

    def doubt(self) -> str | None:
        """One sentence where pairs look wrong, such as left and right exchanged; None where none does."""
        doubts = {sample.id: found for sample in self.samples if (found := _doubts(sample))}
        if not doubts:
            return None
        name, found = next(iter(doubts.items()))
        more = f" (like {len(doubts) - 1} of the other {len(self) - 1})" if len(doubts) > 1 else ""
        return (
            f"benchmark {self.benchmark.name!r}: pair {name!r} looks wrong{more}: {'; '.join(found)}; "
            "sfkit data check looks more closely"
        )

    def _checked(self, pair: Pair) -> tuple[Sample, Mask]:
        sample = pair.load()
        if not is_labelled(pair):
            if self.quantities.needs_truth:
                raise InputError(
                    f"{pair.id}: has no ground truth, found a metric that compares with it, expected census "
                    "alone; or give a labelled benchmark"
                )
            # The first problem says enough.
            for problem in check_sample.problems(sample, labelled=False):
                raise InputError(f"{pair.id}: {problem}")
        try:
            return sample, self.benchmark.rule.valid_mask(sample)
        except InputError as error:
            if not self.quantities.needs_truth:  # ground truth, mask and range play no part
                return sample, np.zeros(sample.size, dtype=np.bool_)
            truth = pair.disparity if isinstance(pair, StereoPair) else None
            raise InputError(f"{truth}: {error}" if truth else str(error)) from error


def _doubts(sample: Sample) -> tuple[str, ...]:
    """What :mod:`~sfkit.datasets.check_sample` finds in a pair with ground truth."""
    labelled = bool(np.isfinite(sample.disparity).any())
    return (*check_sample.problems(sample, labelled=labelled), *check_sample.warnings(sample, LOOK_PIXELS))
