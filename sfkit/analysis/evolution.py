"""Stage 1 in numbers: individuals and their descent, how scores fall, what is chosen, how diverse it is."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.search.journal import JournalledSearch, journalled_score
from sfkit.search.operators import SMALLEST
from sfkit.search.subset import SubsetSearch


@dataclass(frozen=True)
class Individual:
    """One candidate of Stage 1.

    Attributes:
        number: position in the order of creation, from 0.
        subset: names of its sources, in the pool's order.
        score: the validation metric, lower is better; ``inf`` where it failed.
        operators: what made it, in order.
        parents: numbers of the candidates it was bred from.
    """

    number: int
    subset: tuple[str, ...]
    score: float
    operators: tuple[str, ...] = ()
    parents: tuple[int, ...] = ()

    @property
    def failed(self) -> bool:
        """True where there is no finite score."""
        return math.isinf(self.score)


@dataclass(frozen=True)
class PopulationHistory:
    """What a population figure draws; G generations, N sources.

    Attributes:
        sources: the N names, in the pool's order.
        metric: of the scores, such as ``bad-1.0``; None where it is not known.
        best: G scores: the best of everything evaluated up to each generation; ``inf`` where none.
        median: G scores: the median over the individuals of each population, failed ones counted as
            infinitely bad.
        share: G rows of N numbers in [0, 1]: the part of each population that has the source.
        generation: the one whose individuals are listed.
        individuals: that population, best first, ties to the earlier candidate; one that survived more
            than once is listed as often.
    """

    sources: tuple[str, ...]
    metric: str | None
    best: tuple[float, ...]
    median: tuple[float, ...]
    share: tuple[tuple[float, ...], ...]
    generation: int
    individuals: tuple[Individual, ...]

    @property
    def generations(self) -> int:
        """How many populations there are, the initial one included."""
        return len(self.best)


def population_history(
    search: SubsetSearch, *, generation: int | None = None, metric: str | None = None
) -> PopulationHistory:
    """The record of a running or finished Stage 1 search.

    Args:
        search: has finished at least its initial population.
        generation: whose individuals to list; the latest unless given.
        metric: what the scores are, for labels.

    Raises:
        InputError: nothing is finished yet, or no such generation.
    """
    known = [Individual(c.number, c.subset, c.score, c.operators, c.parents) for c in search.state.candidates]
    return summarise(search.sources, known, search.state.populations, generation, metric)


def summarise(
    sources: Sequence[str],
    candidates: Sequence[Individual],
    populations: Sequence[Sequence[int]],
    generation: int | None = None,
    metric: str | None = None,
) -> PopulationHistory:
    """The record from plain values: all candidates by number, and the numbers in each population.

    Raises:
        InputError: no population, or no such generation.
    """
    if not populations:
        raise InputError("population: found no generation yet, expected at least one: call step() first")
    chosen = len(populations) - 1 if generation is None else generation
    if not 0 <= chosen < len(populations):
        raise InputError(
            f"generation: found {chosen}, expected 0 to {len(populations) - 1}, those that are finished"
        )
    people = [[candidates[number] for number in numbers] for numbers in populations]
    return PopulationHistory(
        sources=tuple(sources),
        metric=metric,
        # Survivors keep the best of all (elitism): the best of a population is the best so far.
        best=tuple(min(one.score for one in group) for group in people),
        # The median stands for an infinite score too, which would carry a mean away.
        median=tuple(statistics.median([one.score for one in group]) for group in people),
        share=tuple(_share(group, sources) for group in people),
        generation=chosen,
        individuals=tuple(sorted(people[chosen], key=lambda one: (one.score, one.number))),
    )


def _share(group: Sequence[Individual], sources: Sequence[str]) -> tuple[float, ...]:
    return tuple(sum(name in one.subset for one in group) / len(group) for name in sources)


def _individuals(found: JournalledSearch) -> list[Individual]:
    return [
        Individual(
            int(entry["candidate"]),
            tuple(entry["subset"]),
            journalled_score(entry),
            tuple(entry.get("operators", ())),
            tuple(entry.get("parents", ())),
        )
        for entry in found.candidates
    ]


@dataclass(frozen=True)
class Evolution:
    """What a population view draws; G generations, N sources.

    Attributes:
        history: sources, metric, best and median scores, and how often each source is chosen.
        individuals: every candidate by number.
        populations: G lists of numbers, best first; one that survived more than once is listed as often.
        sizes: G triples: sources in the smallest subset of a population, their mean, and the largest.
        diversity: G numbers in [0, 1]: the mean Jaccard distance (1 - shared / joint sources) of two
            individuals of a population; 0 where all are the same subset.
        archive: numbers of the unique candidates of two sources or more with a finite score, best first.
    """

    history: PopulationHistory
    individuals: tuple[Individual, ...]
    populations: tuple[tuple[int, ...], ...]
    sizes: tuple[tuple[int, float, int], ...]
    diversity: tuple[float, ...]
    archive: tuple[int, ...]


def evolution(search: SubsetSearch, *, metric: str | None = None) -> Evolution:
    """The record of a running or finished Stage 1 search.

    Raises:
        InputError: nothing is finished yet.
    """
    state = search.state
    known = [Individual(c.number, c.subset, c.score, c.operators, c.parents) for c in state.candidates]
    return _evolved(search.sources, known, state.populations, metric)


def watched_evolution(records: Iterable[Mapping[str, Any]], *, metric: str | None = None) -> Evolution:
    """The record of a Stage 1 search that runs elsewhere.

    Args:
        records: what :func:`~sfkit.search.journal.read_journal` returned.
        metric: what the scores are, for labels.

    Raises:
        InputError: the journal holds no generation of Stage 1.
    """
    found = JournalledSearch.begun(records, SubsetSearch.kind)
    return _evolved(found.sources, _individuals(found), found.populations, metric)


def jaccard_diversity(members: NDArray[np.bool_]) -> float:
    """Mean Jaccard distance over all pairs of rows of ``members`` (M, N); 0 for a single row."""
    count = len(members)
    if count < 2:
        return 0.0
    marks = members.astype(np.float64)
    shared = marks @ marks.T
    sizes = marks.sum(axis=1)
    # At least 1: two empty subsets have nothing to divide by.
    joint = np.maximum(sizes[:, None] + sizes[None, :] - shared, 1.0)
    distance = 1.0 - shared / joint
    return float(distance[np.triu_indices(count, k=1)].mean())


def _evolved(
    sources: Sequence[str],
    known: Sequence[Individual],
    populations: Sequence[Sequence[int]],
    metric: str | None,
) -> Evolution:
    history = summarise(sources, known, populations, None, metric)
    groups = [[known[number] for number in numbers] for numbers in populations]
    sizes = [[len(one.subset) for one in group] for group in groups]
    return Evolution(
        history=history,
        individuals=tuple(known),
        populations=tuple(tuple(one.number for one in sorted(group, key=_rank)) for group in groups),
        sizes=tuple((min(row), sum(row) / len(row), max(row)) for row in sizes),
        diversity=tuple(jaccard_diversity(_members(group, sources)) for group in groups),
        archive=_archive(known),
    )


def _members(group: Sequence[Individual], sources: Sequence[str]) -> NDArray[np.bool_]:
    return np.array([[name in one.subset for name in sources] for one in group], dtype=np.bool_)


def _archive(known: Iterable[Individual]) -> tuple[int, ...]:
    first: dict[tuple[str, ...], Individual] = {}
    for one in known:
        # A subset is the candidate that had it first; later ones were not scored again.
        first.setdefault(one.subset, one)
    subsets = (one for one in first.values() if len(one.subset) >= SMALLEST and math.isfinite(one.score))
    return tuple(one.number for one in sorted(subsets, key=_rank))


def _rank(one: Individual) -> tuple[float, int]:
    return one.score, one.number
