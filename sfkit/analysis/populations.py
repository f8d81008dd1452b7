"""Stage 1 in numbers: who is in a population, how scores fall, and how often each source is chosen."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sfkit.errors import InputError
from sfkit.search.journal import last_run
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


def watched_population(
    records: Iterable[Mapping[str, Any]], *, generation: int | None = None, metric: str | None = None
) -> PopulationHistory:
    """The record of a Stage 1 search that runs elsewhere, from its journal.

    Args:
        records: what :func:`~sfkit.search.journal.read_journal` returned.
        generation: whose individuals to list; the latest unless given.
        metric: what the scores are, for labels.

    Raises:
        InputError: the journal holds no generation of Stage 1, or not the one asked for.
    """
    run = last_run((dict(record) for record in records), "subset")
    finished = [record for record in run if record["event"] == "generation"]
    if not finished:
        raise InputError(
            "journal: found no generation of a subset search, expected at least one: run the search first"
        )
    known = [individual_of(entry) for record in finished for entry in record["candidates"]]
    start = next(record for record in run if record["event"] == "start")
    populations = [tuple(record["population"]) for record in finished]
    return summarise(tuple(start["sources"]), known, populations, generation, metric)


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
        median=tuple(statistics.median([one.score for one in group]) for group in people),
        share=tuple(_share(group, sources) for group in people),
        generation=chosen,
        individuals=tuple(sorted(people[chosen], key=lambda one: (one.score, one.number))),
    )


def _share(group: Sequence[Individual], sources: Sequence[str]) -> tuple[float, ...]:
    return tuple(sum(name in one.subset for one in group) / len(group) for name in sources)


def individual_of(entry: Mapping[str, Any]) -> Individual:
    """The individual a journal's record of a candidate tells of."""
    score = math.inf if entry["score"] is None else float(entry["score"])
    return Individual(
        int(entry["candidate"]),
        tuple(entry["subset"]),
        score,
        tuple(entry.get("operators", ())),
        tuple(entry.get("parents", ())),
    )
