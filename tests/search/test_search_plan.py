"""What a plan costs at most is counted by one rule, whoever asks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pytest

from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe
from sfkit.search import Constraints, SubsetSettings
from sfkit.search.plan import SearchPlan

SIX = tuple("abcdef")
PAPER = SearchPlan()


def subsets(names: tuple[str, ...], largest: int | None = None) -> int:
    """Counted one by one: two sources or more."""
    sizes = range(2, (largest or len(names)) + 1)
    return sum(1 for size in sizes for _ in itertools.combinations(names, size))


def test_six_sources_have_57_subsets() -> None:
    """Said before: at most 1100 evaluations, where the paper's sizes ask for 800 + 300."""
    assert subsets(SIX) == 57
    assert PAPER.evaluations(SIX, ("all",)) == 57 + 300
    model = PAPER.by("bayesian")
    assert model.stage2 is not None
    assert model.evaluations(SIX, ("all",)) <= 57 + 6 + model.stage2.evaluations


@pytest.mark.parametrize("largest", [2, 3])
def test_limits_lower_what_it_costs(largest: int) -> None:
    plan = SearchPlan(constraints=Constraints(largest=largest), stage2=None)
    assert plan.evaluations(SIX, ("all",)) == subsets(SIX, largest)


def test_a_large_pool_costs_what_the_sizes_say() -> None:
    names = tuple(map(str, range(11)))
    assert PAPER.evaluations(names, ("all",)) == 50 + 15 * 50 + 300


def test_a_search_asks_for_no_more_than_it_said() -> None:
    plan = SearchPlan(stage1=SubsetSettings(population=6, generations=4), stage2=None)
    asked: set[frozenset[str]] = set()

    def scorer(recipes: Sequence[Recipe]) -> list[Outcome]:
        asked.update(frozenset(recipe.sources) for recipe in recipes)
        return [Outcome(1.0) for _ in recipes]

    plan.subset_search(tuple("abc"), ("all",), scorer).run()
    assert 1 < len(asked) <= plan.evaluations(tuple("abc"), ("all",)) == 4
