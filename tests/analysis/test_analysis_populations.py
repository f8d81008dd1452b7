"""Populations in numbers: shares, medians and orders by hand; the journal tells the same as the search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pytest

from sfkit.analysis.evolution import Individual, population_history, summarise, watched_evolution
from sfkit.errors import InputError
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import Journal, SubsetSearch, SubsetSettings, read_journal

SOURCES = ("a", "b", "c")
CANDIDATES = [
    Individual(0, ("a", "b"), 30.0),
    Individual(1, ("a", "c"), 20.0),
    Individual(2, ("b", "c"), math.inf),
    Individual(3, ("a", "b", "c"), 10.0),
    Individual(4, ("a", "c"), 20.0),
]
POPULATIONS = [(0, 1, 2), (3, 4, 1)]


class Sizes:
    """Prefers small subsets; a subset with ``c`` and without ``a`` fails."""

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        return [self._one(recipe.sources) for recipe in recipes]

    def _one(self, names: tuple[str, ...]) -> Outcome:
        if "c" in names and "a" not in names:
            return Outcome(math.inf, error="no a")
        return Outcome(10.0 * len(names) + len("".join(names)), seconds=0.5)


def test_every_number_of_two_generations_by_hand() -> None:
    history = summarise(SOURCES, CANDIDATES, POPULATIONS, metric="bad-1.0")
    assert history.generations == 2
    assert history.best == (20.0, 10.0)
    assert history.median == (30.0, 20.0)
    assert history.share[0] == pytest.approx((2 / 3, 2 / 3, 2 / 3))
    assert history.share[1] == pytest.approx((1.0, 1 / 3, 1.0))
    assert [one.number for one in history.individuals] == [3, 1, 4]


def test_individuals_of_an_earlier_generation_stand_best_first_and_failures_last() -> None:
    history = summarise(SOURCES, CANDIDATES, POPULATIONS, generation=0)
    assert [one.number for one in history.individuals] == [1, 0, 2]
    assert history.individuals[-1].failed


def test_a_population_of_failures_has_no_best() -> None:
    history = summarise(SOURCES, [CANDIDATES[2]], [(0,)])
    assert history.best == (math.inf,)
    assert history.median == (math.inf,)


@pytest.mark.parametrize("generation", [-1, 2])
def test_a_generation_that_is_not_there_is_refused(generation: int) -> None:
    with pytest.raises(InputError, match=f"generation: found {generation}, expected 0 to 1"):
        summarise(SOURCES, CANDIDATES, POPULATIONS, generation=generation)


def test_before_the_first_step_there_is_nothing_to_show() -> None:
    search = SubsetSearch(SOURCES, ("one",), Sizes(), SubsetSettings(population=4, generations=2))
    with pytest.raises(InputError, match=r"call step\(\) first"):
        population_history(search)


def test_search_and_journal_tell_the_same(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    settings = SubsetSettings(population=6, generations=3, seed=1)
    search = SubsetSearch(SOURCES, ("one", "two"), Sizes(), settings, journal=journal)
    search.run()
    told = population_history(search, metric="epe")
    assert watched_evolution(read_journal(journal.path), metric="epe").history == told
    assert told.generations == 4
    assert all(len(row) == len(SOURCES) for row in told.share)
    assert told.best[-1] == search.best.score  # type: ignore[union-attr]


def test_a_journal_without_a_subset_search_is_refused() -> None:
    with pytest.raises(InputError, match="no generation of a subset search"):
        watched_evolution([{"event": "start", "search": "routing"}])
