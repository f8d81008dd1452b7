"""One worker: a live model and a prepared benchmark. Every engine runs this same piece."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.live import LiveModel
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True)
class Result:
    """What one recipe did on one benchmark.

    Attributes:
        images: per-image errors in the benchmark's order; empty where it failed.
        failure: the error's type and message, None where there was none.
        seconds: wall time of merging and forward passes.
    """

    images: tuple[ImageErrors, ...]
    failure: str | None
    seconds: float


class Worker:
    """Merges recipes into one live network and runs it over the benchmark's images."""

    def __init__(self, model: LiveModel, benchmark: PreparedBenchmark) -> None:
        self.model = model
        self.benchmark = benchmark

    def run(self, recipe: Recipe) -> Result:
        """Evaluate one recipe; an error of the network is a result, not the end of the run."""
        started = time.perf_counter()
        images: tuple[ImageErrors, ...] = ()
        failure = None
        try:
            self.model.apply(recipe)
            images = tuple(
                self.benchmark.errors(sample, self.predict(number))
                for number, sample in enumerate(self.benchmark.samples)
            )
        except Exception as error:  # whatever a network raises is recorded as this candidate's failure
            failure = f"{type(error).__name__}: {error}"
        return Result(images, failure, time.perf_counter() - started)

    def predict(self, number: int) -> NDArray[np.float32]:
        """Disparity (H, W) in pixels of one pair under the recipe the model holds now."""
        pair = self.benchmark.pair(number)
        map_: NDArray[np.float32] = pair.window.crop(self.model.disparity(pair.left, pair.right)).numpy()
        return map_
