"""What an edited recipe does to one pair, again and again: a quick look first where the full one is slow."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.pair_maps import Comparand, Map
from sfkit.architectures import PreparedPair
from sfkit.datasets.pairs import Sample
from sfkit.errors import ensure_known
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.store import evaluation_key
from sfkit.merging.recipe import Recipe

QUICK_SECONDS = 0.06
"""A look that takes longer is preceded by one at reduced size."""

SMALLEST = 4
"""Images are reduced by at most this factor."""


@dataclass(frozen=True, eq=False)
class PairLook:
    """One recipe on one pair.

    Attributes:
        disparity: (H / reduction, W / reduction) float32 pixels of the full size; may hold values that are
            not finite.
        error: the same shape, |disparity - ground truth| in pixels: NaN where the protocol counts no pixel,
            ``inf`` where the prediction is not finite; of a pair without ground truth its census residual in
            percent (:mod:`~sfkit.analysis.pair_maps`).
        score: the evaluator's metric on this pair; None at reduced size, where it would mean another thing.
        reduction: 1 for the full size, else by how much height and width were divided.
        seconds: what merging and the forward pass took.
    """

    disparity: Map
    error: Map
    score: float | None
    reduction: int
    seconds: float


class PairPreview:
    """A network of its own, re-merged in place, and the pair it is shown on; safe to use from any thread.

    Args:
        evaluator: gives pool, loaded benchmark, metric and device. Its own network is not touched, so that a
            search may go on with it.
        pair: an id of the benchmark; the first pair unless given.

    Raises:
        InputError: no such pair.
    """

    def __init__(self, evaluator: Evaluator, pair: str | None = None) -> None:
        self.evaluator = evaluator
        self._model = evaluator.compute.model(evaluator.pool)
        # One network, re-merged in place: two looks at once would mix their weights.
        self._busy = threading.Lock()
        self._reduced: dict[int, tuple[PreparedPair, Comparand]] = {}
        self.choose(pair or evaluator.benchmark.ids[0])

    @property
    def sample(self) -> Sample:
        """The pair's images and ground truth."""
        return self.evaluator.prepared.samples[self._number]

    @property
    def limits(self) -> tuple[float, float]:
        """The colour range of disparities in pixels: of the ground truth, else of the pair's first look."""
        if self._limits is None:
            raise RuntimeError("a pair without ground truth has no colour range before its first look")
        return self._limits

    def choose(self, pair: str) -> None:
        """Look at another pair.

        Raises:
            InputError: no such pair.
        """
        benchmark = self.evaluator.benchmark
        ensure_known(f"pair of benchmark {benchmark.name!r}", pair, benchmark.ids)
        with self._busy:
            self.pair, self._number = pair, benchmark.ids.index(pair)
            truth = self.evaluator.prepared.truth(self._number)
            self.comparand = Comparand.of(self.sample, truth, self.evaluator.metric)
            # Colour range, sizes and pace are those of a pair.
            self._limits: tuple[float, float] | None = None
            self._reduced.clear()
            self._full_seconds = math.inf

    def look(self, recipe: Recipe) -> PairLook:
        """The recipe at full size, with its score."""
        with self._busy:
            started = time.perf_counter()
            prediction = self._predict(recipe, self.evaluator.prepared.pair(self._number))
            seconds = time.perf_counter() - started
            self._full_seconds = min(self._full_seconds, seconds)  # others may have used the machine, too
            errors = self.evaluator.prepared.errors(self._number, prediction)
            score = errors.value(self.evaluator.metric)
            # The first look sets the colours: an edit then shows as a change of disparity alone.
            self._limits = self._limits or self.comparand.limits(prediction)
            return PairLook(prediction, self.comparand.map(prediction), score, 1, seconds)

    def quick_look(self, recipe: Recipe) -> PairLook:
        """The recipe at a size that takes about ``QUICK_SECONDS``: the full one where that is quick."""
        # How long a whole look takes is known after the first.
        reduction = reduction_for(self._full_seconds) if math.isfinite(self._full_seconds) else 1
        if reduction == 1:
            return self.look(recipe)
        with self._busy:
            started = time.perf_counter()
            pair, comparand = self._reduced_pair(reduction)
            small = self._predict(recipe, pair)
            seconds = time.perf_counter() - started
            # Errors in pixels grow back with the size; residuals are in percent.
            wrong = comparand.map(small) * np.float32(reduction if comparand.labelled else 1)
            return PairLook(small * np.float32(reduction), wrong, None, reduction, seconds)

    def _predict(self, recipe: Recipe, pair: PreparedPair) -> Map:
        self._model.apply(recipe)
        disparity: Map = pair.window.crop(self._model.disparity(pair.left, pair.right)).numpy()
        return disparity

    def _reduced_pair(self, reduction: int) -> tuple[PreparedPair, Comparand]:
        if reduction not in self._reduced:
            left, right = (_shrunk(image, reduction) for image in (self.sample.left, self.sample.right))
            prepared = self.evaluator.prepared.inputs.prepare(left, right)
            self._reduced[reduction] = prepared, self.comparand.reduced(left, right, reduction)
        return self._reduced[reduction]


def reduction_for(seconds: float) -> int:
    """By how much to divide height and width of images that take ``seconds``: a power of 2, at most 4."""
    reduction = 1
    # Time goes with the pixels: half the size takes a quarter of it.
    while seconds / reduction**2 > QUICK_SECONDS and reduction < SMALLEST:
        reduction *= 2
    return reduction


def held_score(evaluator: Evaluator, recipe: Recipe) -> float | None:
    """The benchmark score the evaluation store holds, ``inf`` where the recipe failed; None where unknown."""
    held = evaluator.store.get(evaluation_key(evaluator.describe(recipe)))
    return None if held is None else evaluator.outcome(held).score


def _shrunk(image: NDArray[np.uint8], reduction: int) -> NDArray[np.uint8]:
    """An image averaged down to (ceil(H / reduction), ceil(W / reduction)), as strides would leave it."""
    height, width = (-(-side // reduction) for side in image.shape[:2])
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
