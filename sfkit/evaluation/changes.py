"""Scores of unlike metrics made comparable: the change against the uniform merge, in units of its spread."""

from __future__ import annotations

import statistics
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator

LABEL = "change against uniform, in standard deviations over its images"


@dataclass(frozen=True)
class Yardstick:
    """What a benchmark's scores are measured against.

    Attributes:
        uniform: the score of the uniform merge, in the metric's unit.
        spread: standard deviation of its per-image values over the benchmark's images, in the same unit.
    """

    uniform: float
    spread: float

    def change(self, score: float) -> float:
        """A score as a number of spreads above the uniform merge's; below 0 is better."""
        return (score - self.uniform) / self.spread


class Changes:
    """The yardsticks of several benchmarks, made when the first score is asked for.

    Benchmarks of one image, or whose images all score alike, have no spread.

    Args:
        evaluators: one for each benchmark; the uniform merge is that of their pool.

    Raises:
        InputError: a benchmark has fewer than two images.
    """

    def __init__(self, evaluators: Sequence[Evaluator]) -> None:
        for evaluator in evaluators:
            if len(evaluator.benchmark) < 2:
                raise InputError(
                    f"benchmark {evaluator.benchmark.name!r}: has one pair, expected two or more to combine "
                    f"{evaluator.metric} with another metric in units of the spread over pairs: add some, or "
                    "guide by one metric"
                )
        self._evaluators = tuple(evaluators)
        self._made: tuple[Yardstick, ...] = ()
        self._lock = threading.Lock()

    def yardsticks(self) -> tuple[Yardstick, ...]:
        """One a benchmark.

        Raises:
            InputError: the uniform merge failed, or scores alike on all images of a benchmark.
        """
        with self._lock:
            if not self._made:
                self._made = tuple(_yardstick(evaluator) for evaluator in self._evaluators)
        return self._made


def _yardstick(evaluator: Evaluator) -> Yardstick:
    (evaluation,) = evaluator.evaluate([evaluator.pool.uniform()])
    if evaluation.failure:
        raise InputError(
            f"benchmark {evaluator.benchmark.name!r}: the uniform merge failed "
            f"({evaluation.failure}), expected a score that others are compared with: guide by one metric"
        )
    spread = statistics.stdev(image.value(evaluator.metric) for image in evaluation.images)
    if spread == 0:
        raise InputError(
            f"benchmark {evaluator.benchmark.name!r}: the uniform merge has the same {evaluator.metric} on "
            "all pairs, expected a spread to measure changes in: guide by one metric"
        )
    return Yardstick(evaluator.score(evaluation.images), spread)
