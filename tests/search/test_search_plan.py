"""What a plan costs at most is counted by one rule, whoever asks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest
from tiny import write_pool

from sfkit.errors import InputError
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.search import (
    BayesianRoutingSettings,
    BayesianSubsetSettings,
    Constraints,
    RoutingSearch,
    RoutingSettings,
    SubsetSearch,
    SubsetSettings,
)
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


@pytest.mark.parametrize(
    ("batch", "generations"), [(1, 41), (2, 21), (4, 11), (16, 3), (20, 3), (41, 3), (64, 3), (500, 3)]
)
def test_a_batch_of_any_size_is_proposed_three_times(batch: int, generations: int) -> None:
    """A batch learns nothing of itself: one of 64 in place of 41 proposals would be a single look."""
    plan = PAPER.by("bayesian", batch)
    assert plan.stage1 == BayesianSubsetSettings(generations=generations, batch=batch)
    assert plan.stage2 == BayesianRoutingSettings(batch=batch)
    eleven = tuple(map(str, range(11)))
    assert plan.evaluations(eleven, ("all",)) == 11 + 8 + generations * batch + 80


def test_a_model_searches_what_was_asked_for() -> None:
    """Whatever of Stage 2 says what is searched, or how far from x = 0 it begins, is carried over."""
    second = RoutingSettings(
        sigma=0.2, gamma=(0.5, 1.5), tied=False, scaled=False, rank=2, entropy=0.1, shrinkage=0.2, floor=0.1
    )
    plan = SearchPlan(stage1=SubsetSettings(seed=3), stage2=replace(second, seed=4)).by("bayesian")
    assert plan.stage1 == BayesianSubsetSettings(seed=3)
    assert plan.stage2 == BayesianRoutingSettings(
        sigma=0.2,
        gamma=(0.5, 1.5),
        tied=False,
        scaled=False,
        rank=2,
        entropy=0.1,
        shrinkage=0.2,
        floor=0.1,
        seed=4,
    )
    assert plan.by("paper").stage2 == replace(second, seed=4)


def test_the_paper_s_method_has_no_batch() -> None:
    with pytest.raises(InputError, match=r"^batch: found 4 with method paper, .*take method bayesian$"):
        PAPER.by("paper", 4)


@pytest.mark.parametrize(
    ("record", "paper", "values"),
    [
        (
            BayesianSubsetSettings,
            SubsetSettings,
            {"crossover": 0.5, "mutation": 0.5, "redraw": False, "survival": "truncation"},
        ),
        (
            BayesianRoutingSettings,
            RoutingSettings,
            {"population": 9, "converge": False, "tolfun": 0.5, "tolx": 0.5},
        ),
    ],
)
def test_a_model_s_settings_refuse_what_it_does_not_use(
    record: type, paper: type, values: dict[str, object]
) -> None:
    for name, value in values.items():
        sentence = rf"^{name}: found {value!r}, expected .*take {paper.__name__} \(--method paper\)$"
        with pytest.raises(InputError, match=sentence):
            record(**{name: value})
        record(**{name: getattr(paper(), name)})


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


SETTINGS = [
    *(SubsetSettings(population=p, generations=g) for p in (2, 5, 50) for g in (0, 3)),
    *(
        BayesianSubsetSettings(population=p, generations=g, singles=singles, batch=3)
        for p in (2, 50)
        for g in (0, 4)
        for singles in (True, False)
    ),
]


@pytest.mark.parametrize("stage1", SETTINGS)
@pytest.mark.parametrize("limits", [Constraints(), Constraints(exclude=("b",), largest=3)])
def test_what_a_search_would_propose_is_known_without_it(stage1: SubsetSettings, limits: Constraints) -> None:
    search = SearchPlan(stage1=stage1, constraints=limits).subset_search(SIX, ("all",), nobody)
    assert stage1.proposals(search.space) == search.most


def nobody(recipes: Sequence[Recipe]) -> list[Outcome]:
    raise AssertionError("a plan that is only asked scores nothing")


EVEN = Recipe.equal(("a", "b"), ("backbone", "neck", "cost_volume", "head"))
REFUSED = {
    "unknown source": SearchPlan(constraints=Constraints(include=("x",))),
    "nothing left": SearchPlan(constraints=Constraints(exclude=("a", "b"))),
    "unknown block": SearchPlan(constraints=Constraints(frozen_blocks=("tail",))),
    "excluded": SearchPlan(subset=("a", "b"), constraints=Constraints(exclude=("a",))),
    "too many": SearchPlan(subset=("a", "b", "c"), constraints=Constraints(largest=2)),
    "one source": SearchPlan(subset=("a",)),
    "no such subset": SearchPlan(subset=("a", "x")),
    "other start": SearchPlan(subset=("a", "c"), start=EVEN),
    "nothing moves": SearchPlan(
        subset=("a", "b"),
        stage2=RoutingSettings(tied=False),
        constraints=Constraints(frozen_blocks=EVEN.blocks),
    ),
}


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return open_pool(write_pool(tmp_path_factory.mktemp("plan")))


def build(plan: SearchPlan, pool: Pool) -> None:
    """Both searches, as far as the plan has them."""
    if plan.subset is None:
        plan.subset_search(pool.names, pool.blocks, nobody)
    plan.routing_search(pool, plan.subset or pool.names, nobody)


@pytest.mark.parametrize("plan", REFUSED.values(), ids=REFUSED)
def test_a_plan_is_refused_as_its_searches_are(
    plan: SearchPlan, pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError) as late:
        build(plan, pool)
    for search in (SubsetSearch, RoutingSearch):
        monkeypatch.setattr(search, "__init__", None)  # no search is built for a check
    with pytest.raises(InputError) as early:
        plan.check(pool)
    assert str(early.value) == str(late.value)


def test_a_plan_that_can_be_searched_passes(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    for search in (SubsetSearch, RoutingSearch):
        monkeypatch.setattr(search, "__init__", None)
    for plan in (
        PAPER,
        PAPER.by("bayesian"),
        SearchPlan(stage2=RoutingSettings(holdout=0.5)),
        SearchPlan(subset=("a", "b"), start=EVEN),
        SearchPlan(constraints=Constraints(include=("c",), exclude=("a",))),
    ):
        plan.check(pool)
        assert plan.evaluations(pool.names, pool.blocks) > 0
