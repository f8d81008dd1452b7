"""What a search will cost, from one timed evaluation before it starts."""

from __future__ import annotations

import resource
import sys
from dataclasses import dataclass

from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True)
class Estimate:
    """Cost of a search, at most.

    Attributes:
        evaluations: the largest number of evaluations; duplicates and cached ones cost nothing.
        seconds_each: one evaluation's seconds, merging and forward passes, as just timed (or as the store
            remembers it).
        memory_bytes: the most memory this process has used so far, model and images included.
        images: pairs in the validation benchmark.
        workers: how many evaluate at a time.
    """

    evaluations: int
    seconds_each: float
    memory_bytes: int
    images: int
    workers: int = 1

    @property
    def minutes(self) -> float:
        """Minutes for all evaluations, on workers that never wait for each other."""
        return self.evaluations * self.seconds_each / self.workers / 60.0

    def __str__(self) -> str:
        many = f" and {self.workers} at a time" if self.workers > 1 else ""
        return (
            f"at most {self.evaluations} evaluations of {self.images} pair{'s' if self.images != 1 else ''}, "
            f"{self.seconds_each:.2f} s each{many}: {self.minutes:.1f} minutes at most; "
            f"memory so far {self.memory_bytes / 2**30:.1f} GiB"
        )


def estimate(evaluator: Evaluator, recipe: Recipe, evaluations: int) -> Estimate:
    """Time one evaluation of ``recipe`` (it is stored, so a search never repeats it)."""
    outcome = evaluator([recipe])[0]
    images, workers = len(evaluator.benchmark), evaluator.engine.workers
    return Estimate(evaluations, outcome.seconds, peak_memory(), images, workers)


def peak_memory() -> int:
    """The largest resident memory of this process so far, in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
