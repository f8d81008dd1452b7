"""Stage 1 as a whole: every individual and its descent, and how the populations change over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.populations import Individual, PopulationHistory, individual_of, summarise
from sfkit.errors import InputError
from sfkit.search.journal import last_run
from sfkit.search.subset import SubsetSearch


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
        archive: numbers of the unique candidates with a finite score, best first.
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
    run = last_run((dict(record) for record in records), "subset")
    finished = [record for record in run if record["event"] == "generation"]
    if not finished:
        raise InputError(
            "journal: found no generation of a subset search, expected at least one: run the search first"
        )
    start = next(record for record in run if record["event"] == "start")
    known = [individual_of(entry) for record in finished for entry in record["candidates"]]
    return _evolved(start["sources"], known, [tuple(record["population"]) for record in finished], metric)


def jaccard_diversity(members: NDArray[np.bool_]) -> float:
    """Mean Jaccard distance over all pairs of rows of ``members`` (M, N); 0 for a single row."""
    count = len(members)
    if count < 2:
        return 0.0
    marks = members.astype(np.float64)
    shared = marks @ marks.T
    sizes = marks.sum(axis=1)
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
        first.setdefault(one.subset, one)
    return tuple(one.number for one in sorted(first.values(), key=_rank) if math.isfinite(one.score))


def _rank(one: Individual) -> tuple[float, int]:
    return one.score, one.number
