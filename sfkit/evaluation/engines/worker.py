"""One worker: a live model and a prepared benchmark. Every engine runs this same piece."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.errors import SfkitError
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.live import LiveModel
from sfkit.merging.recipe import Recipe

AHEAD = 2  # maps that wait for their errors to be counted, at most, while the network goes on


class DeviceLostError(SfkitError):
    """A device answers no more: what this process computes on it from now on would say nothing."""


@dataclass(frozen=True)
class Result:
    """What one recipe did on one benchmark, or on some of its images.

    Attributes:
        images: per-image errors in the benchmark's order; empty where it failed.
        failure: the error's type and message, None where there was none.
        seconds: time of merging and forward passes; summed over workers that shared the images.
        cpu_seconds: what all threads of the worker's process took of processors meanwhile, summed likewise;
            None where that is not known.
    """

    images: tuple[ImageErrors, ...]
    failure: str | None
    seconds: float
    cpu_seconds: float | None = None


class Worker:
    """Merges recipes into one live network and runs it over the benchmark's images."""

    def __init__(self, model: LiveModel, benchmark: PreparedBenchmark) -> None:
        self.model = model
        self.benchmark = benchmark
        self._held: Recipe | None = None  # what a merge completed, and is still in the model

    def run(self, recipe: Recipe) -> Result:
        """Evaluate one recipe; an error of the network is a result, not the end of the run."""
        return self.part(recipe, 0, len(self.benchmark))

    def part(self, recipe: Recipe, start: int, stop: int) -> Result:
        """Evaluate one recipe on images ``start..stop``; parts of one recipe in a row merge it once.

        Raises:
            DeviceLostError: the device failed, rather than the network: another worker may do better.
        """
        started, worked = time.perf_counter(), time.process_time()
        images: tuple[ImageErrors, ...] = ()
        failure = None
        try:
            self._hold(recipe)
            images = self._errors(range(start, stop))
        except Exception as error:  # whatever a network raises is recorded as this candidate's failure
            failure = f"{type(error).__name__}: {error}"
            self._check_device(failure)
        took = time.perf_counter() - started, time.process_time() - worked
        return Result(images, failure, *took)

    def as_it_is(self) -> tuple[ImageErrors, ...]:
        """Per-image errors of the network with whatever values it has."""
        return self._errors(range(len(self.benchmark)))

    def _errors(self, numbers: range) -> tuple[ImageErrors, ...]:
        """Errors of each pair, counted in a thread of their own while the network runs on the next pair."""
        device = str(self.model.device)
        with ThreadPoolExecutor(1) as counting:
            jobs: list[Future[ImageErrors]] = []
            for number in numbers:
                if len(jobs) >= AHEAD:
                    # Waits for an earlier count: maps would pile up where counting is slower than the
                    # network.
                    jobs[-AHEAD].result()
                # A copy: a network may write its next map where this one lies.
                prediction = self.predict(number).copy()
                jobs.append(counting.submit(self.benchmark.errors, number, prediction, device))
            return tuple(job.result() for job in jobs)

    def predict(self, number: int) -> NDArray[np.float32]:
        """Disparity (H, W) in pixels of one pair under the recipe the model holds now."""
        pair = self.benchmark.pair(number)
        map_: NDArray[np.float32] = pair.window.crop(self.model.disparity(pair.left, pair.right)).numpy()
        return map_

    def _hold(self, recipe: Recipe) -> None:
        if recipe == self._held and self.model.recipe is self._held:
            return
        self._held = None
        # Held by nobody until it is whole: a merge that fails half-way leaves no recipe in the network.
        self.model.apply(recipe)
        self._held = recipe

    def _check_device(self, failure: str) -> None:
        """After some CUDA errors every later call fails too: then no candidate is to blame."""
        if self.model.device.type != "cuda":
            return
        try:
            # CUDA tells of errors late: asked to finish, it says whether it works.
            torch.cuda.synchronize(self.model.device)
        except RuntimeError as error:
            raise DeviceLostError(
                f"{self.model.device}: does not answer after an error ({failure}), start the process again"
            ) from error
