"""What searches leave behind: candidates, generations, counts, a table; and pure functions that rank them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from sfkit.cards import card
from sfkit.evaluation.outcome import Outcome, total_known
from sfkit.merging.recipe import Recipe

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One recipe a search asked for, and what it scored.

    Attributes:
        number: position in the order of creation, from 0; ties go to the smaller number.
        generation: the generation that created it, from 0.
        recipe: what was scored.
        outcome: what the scorer answered.
        repeated: True where this search had already asked for the same recipe, so that the scorer was
            not asked again and ``outcome`` is the first answer.
    """

    number: int
    generation: int
    recipe: Recipe
    outcome: Outcome
    repeated: bool

    @property
    def subset(self) -> tuple[str, ...]:
        """The recipe's sources, in the pool's order."""
        return self.recipe.sources

    @property
    def score(self) -> float:
        """The benchmark's metric, lower is better; ``inf`` where there is no finite score."""
        finite = not self.outcome.failed and math.isfinite(self.outcome.score)
        return self.outcome.score if finite else math.inf

    @property
    def failed(self) -> bool:
        """True where there is no finite score: the candidate loses against every other."""
        return math.isinf(self.score)

    @property
    def fitness(self) -> float:
        """What the search minimises; ``inf`` where the candidate failed."""
        return self.score

    @property
    def rank(self) -> tuple[float, int]:
        """Sorts candidates, best first: by fitness, ties to the earlier one."""
        return (self.fitness, self.number)

    def _repr_html_(self) -> str:
        facts = {
            "score": "failed" if self.failed else f"{self.score:.2f}",
            "generation": self.generation,
            "error": self.outcome.error,
        }
        return card(f"Candidate {self.number}", facts) + self.recipe._repr_html_()

    def as_record(self) -> dict[str, Any]:
        """Plain values for the history and the journal."""
        return {
            "candidate": self.number,
            "generation": self.generation,
            "subset": self.subset,
            "size": len(self.subset),
            "score": self.score,
            "failed": self.failed,
            "error": self.outcome.error,
            "cached": self.outcome.cached,
            "repeated": self.repeated,
            "seconds": self.outcome.seconds,
            "cpu_seconds": self.outcome.cpu_seconds,
            "key": self.outcome.key,
        }


@dataclass(frozen=True, kw_only=True)
class SubsetCandidate(Candidate):
    """A subset and how it came about.

    Attributes:
        chromosome: the subset's names in the order of its genes.
        parents: numbers of the candidates it was bred from; one for a copy, none in generation 0.
        operators: what made it, in order: "random" or "start"; "crossover" or "copy", then maybe
            "replace", "insert" or "delete".
    """

    chromosome: tuple[str, ...]
    parents: tuple[int, ...]
    operators: tuple[str, ...]

    def as_record(self) -> dict[str, Any]:
        """Plain values for the history and the journal."""
        return {
            **super().as_record(),
            "chromosome": self.chromosome,
            "parents": self.parents,
            "operators": self.operators,
        }


C = TypeVar("C", bound=Candidate)


@dataclass(frozen=True)
class Counts:
    """How many evaluations a search has asked for so far.

    Attributes:
        candidates: candidates proposed, repeated ones included.
        distinct: recipes handed to the scorer; the other candidates were repeated.
        cached: of the distinct ones, those whose score came from the evaluation store.
        failed: of the distinct ones, those without a finite score.
        seconds: evaluation time spent on behalf of this search: of the distinct, not cached ones.
        seconds_saved: what the cached ones took when they were computed.
        cpu_seconds: what the former took of processors; None where nobody measured one of them.
        cpu_seconds_saved: the same of the cached ones.
    """

    candidates: int = 0
    distinct: int = 0
    cached: int = 0
    failed: int = 0
    seconds: float = 0.0
    seconds_saved: float = 0.0
    cpu_seconds: float | None = None
    cpu_seconds_saved: float | None = None

    @property
    def repeated(self) -> int:
        """Candidates this search had already asked for."""
        return self.candidates - self.distinct


@dataclass(frozen=True)
class Generation(Generic[C]):
    """What one ``step()`` did.

    Attributes:
        number: 0 for the initial population.
        candidates: the candidates it created, in order.
        best: the best of the whole search so far, None where nothing has a finite score yet.
        counts: of the whole search so far.
        done: True where no further step is left.
        reason: why it is done, None where it is not.
    """

    number: int
    candidates: tuple[C, ...]
    best: C | None
    counts: Counts
    done: bool
    reason: str | None


def count(candidates: Sequence[Candidate]) -> Counts:
    """Count evaluations over all candidates of a search."""
    distinct = [candidate for candidate in candidates if not candidate.repeated]
    cached = [candidate for candidate in distinct if candidate.outcome.cached]
    computed = [candidate for candidate in distinct if not candidate.outcome.cached]
    # Exact sums: the same in whatever order engines answered.
    total = math.fsum(candidate.outcome.seconds for candidate in distinct)
    saved = math.fsum(candidate.outcome.seconds for candidate in cached)
    return Counts(
        candidates=len(candidates),
        distinct=len(distinct),
        cached=len(cached),
        failed=sum(candidate.failed for candidate in distinct),
        seconds=total - saved,
        seconds_saved=saved,
        cpu_seconds=total_known(candidate.outcome.cpu_seconds for candidate in computed),
        cpu_seconds_saved=total_known(candidate.outcome.cpu_seconds for candidate in cached),
    )


def ranked(candidates: Iterable[C]) -> tuple[C, ...]:
    """The unique candidates with a finite score, best first: the archive of Algorithm 1."""
    # A repeated one is the same network again, which would take two places of the archive.
    scored = (candidate for candidate in candidates if not (candidate.repeated or candidate.failed))
    return tuple(sorted(scored, key=lambda candidate: candidate.rank))


COMMON = ("candidate", "generation", "subset", "size", "score", "failed", "error")
"""Columns every history starts with."""

ORIGIN = ("cached", "repeated", "seconds", "cpu_seconds", "key")
"""Columns that tell where a score came from."""


def subset_history(
    candidates: Sequence[SubsetCandidate],
    populations: Sequence[Sequence[int]],
    predicted: Sequence[str] = (),
) -> pd.DataFrame:
    """Table of a Stage 1 search.

    Columns: ``candidate`` (number, from 0), ``generation`` (from 0), ``subset`` (tuple of names in the
    pool's order), ``size``, ``score`` (the benchmark's unit; inf where it failed), ``failed``, ``error``
    (None where it did not fail), ``cached`` (from the evaluation store), ``repeated`` (asked for before
    by this search), ``seconds`` (what the evaluation took when it was computed), ``cpu_seconds``
    (of processors, workers' included; None where nobody measured that), ``key`` (in the store),
    ``chromosome`` (tuple of names in the order of the genes), ``parents`` (tuple of numbers),
    ``operators`` (tuple, in order), ``survived`` (True where the candidate is in the population of its
    own generation), and those of ``predicted``.
    """
    survived = [set(population) for population in populations]
    rows = [
        {**candidate.as_record(), "survived": candidate.number in survived[candidate.generation]}
        for candidate in candidates
    ]
    columns = [*COMMON, *ORIGIN, "chromosome", "parents", "operators", "survived", *predicted]
    # Late: only tables need it, and its import takes long.
    import pandas as pd

    return pd.DataFrame(rows, columns=columns)
