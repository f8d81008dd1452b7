"""What a search will cost, from one timed evaluation before it starts."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

from sfkit.errors import InputError
from sfkit.evaluation.combining import CombinedScorer, only_evaluators
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


def estimate(scorer: Evaluator | CombinedScorer, recipe: Recipe, evaluations: int) -> Estimate:
    """Time one evaluation of ``recipe`` (it is stored, so a search never repeats it).

    Of several benchmarks seconds and pairs are summed.

    Raises:
        InputError: a combination of scorers that are no evaluators, which tell no number of pairs.
    """
    known = only_evaluators(scorer)
    if not known:
        raise InputError(
            "estimate: found a scorer that is no Evaluator, expected evaluators, which know pairs"
        )
    seconds = sum(evaluator([recipe])[0].seconds for evaluator in known)
    images = sum(len(evaluator.benchmark) for evaluator in known)
    # All wait for the one with the fewest.
    workers = min(evaluator.engine.workers for evaluator in known)
    return Estimate(evaluations, seconds, peak_memory(), images, workers)


def peak_memory() -> int:
    """The largest resident memory of this process so far, in bytes; 0 on Windows, which does not say."""
    status = Path("/proc/self/status")  # getrusage counts from the peak of the process that started this one
    if status.is_file() and (own := re.search(r"^VmHWM:\s+(\d+) kB$", status.read_text(), re.MULTILINE)):
        return int(own[1]) * 1024
    try:
        import resource
    except ModuleNotFoundError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Bytes on macOS, kilobytes elsewhere.
    return peak if sys.platform == "darwin" else peak * 1024
