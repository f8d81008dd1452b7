"""What a search is told of a candidate: its score, and where it came from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from sfkit.merging.recipe import Recipe


@dataclass(frozen=True)
class Part:
    """One evaluation seen through a hold-out split; both scores are of the same forward passes.

    Attributes:
        guiding: score over the images that may guide a search, in the metric's unit.
        held: score over the images held out from it.

    Of a benchmark that is combined with others one of the two may be NaN: none of its images is there.
    """

    guiding: float
    held: float


@dataclass(frozen=True)
class Outcome:
    """One scored recipe.

    Attributes:
        score: the benchmark's metric, lower is better (percent for bad-t and D1, pixels for EPE);
            ``inf`` where the candidate failed.
        seconds: what the evaluation took when it was computed, in seconds.
        cached: True where the score came from the evaluation store.
        error: why the candidate failed, None where it did not.
        key: the evaluation's key in the store.
        parts: the same evaluation by each split of a hold-out scorer; empty without one, and where the
            candidate failed.
        cpu_seconds: what it took of processors when it was computed; None where nobody measured that.
    """

    score: float
    seconds: float = 0.0
    cached: bool = False
    error: str | None = None
    key: str = ""
    parts: tuple[Part, ...] = ()
    cpu_seconds: float | None = None

    @property
    def failed(self) -> bool:
        """True where there is no score to compare."""
        return self.error is not None or math.isnan(self.score)


class Scorer(Protocol):
    """Scores recipes in the order given; all that a search knows of networks and images."""

    def __call__(self, recipes: Sequence[Recipe]) -> Sequence[Outcome]:
        """One outcome a recipe, in order; each is in the store before this returns."""
        ...


def total_known(values: Iterable[float | None]) -> float | None:
    """The sum of numbers, such as CPU seconds; None where one is not known, since part of a sum misleads."""
    found = list(values)
    known = [value for value in found if value is not None]
    return math.fsum(known) if len(known) == len(found) else None
