"""The workbench: where it starts, trials it takes on, pins, and scores that go to the store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import write_pairs, write_pool

from sfkit.analysis import routing_trace
from sfkit.analysis.workbench import RoutingWorkbench
from sfkit.datasets.benchmark import open_benchmark
from sfkit.editing import seen_by_hand
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.merging import Recipe, open_pool
from sfkit.search import Journal, RoutingSearch, RoutingSettings

SETTINGS = RoutingSettings(evaluations=9, population=4, tied=False, gamma=(0.5, 1.5))


@pytest.fixture(scope="module")
def evaluator(tmp_path_factory: pytest.TempPathFactory) -> Evaluator:
    folder: Path = tmp_path_factory.mktemp("world")
    pool = open_pool(write_pool(folder / "pool"))
    return Evaluator(pool, open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0"))


@pytest.fixture(scope="module")
def searched(evaluator: Evaluator, tmp_path_factory: pytest.TempPathFactory) -> tuple[RoutingSearch, Path]:
    """A finished Stage 2 search over two of three sources, and its journal."""
    journal = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    search = RoutingSearch(("a", "c"), evaluator.pool.blocks, evaluator, SETTINGS, journal=Journal(journal))
    search.run()
    return search, journal


def of_another(evaluator: Evaluator) -> Recipe:
    return replace(evaluator.pool.equal("a"), merged_from={"a": "the fingerprint of another network"})


def test_it_starts_from_equal_weights(evaluator: Evaluator) -> None:
    bench = RoutingWorkbench(evaluator, ("a", "c"))
    assert bench.recipe == evaluator.pool.equal("a", "c")
    assert (bench.draft.tied, bench.draft.gamma) == (True, (0.25, 1.75))
    assert RoutingWorkbench(evaluator).draft.sources == evaluator.pool.names


def test_it_starts_from_a_search_s_best_in_the_search_s_bounds(
    evaluator: Evaluator, searched: tuple[RoutingSearch, Path]
) -> None:
    search, journal = searched
    assert search.best is not None
    for given in (search, journal, str(journal), routing_trace(search)):
        bench = RoutingWorkbench(evaluator, search=given)
        assert bench.recipe == search.best.recipe
        assert bench.draft.gamma == (0.5, 1.5)
        assert not bench.draft.tied
        assert [bench.trial(n) for n in range(9)] == [c.recipe for c in search.candidates]


def test_a_search_may_be_over_fewer_sources_and_not_yet_begun(
    evaluator: Evaluator, searched: tuple[RoutingSearch, Path]
) -> None:
    bench = RoutingWorkbench(evaluator, ("a", "b", "c"), search=searched[0], tied=False)
    assert bench.recipe.of("neck")[0]["b"] == 0.0
    fresh = RoutingSearch(("a", "c"), evaluator.pool.blocks, evaluator, SETTINGS)
    begun = RoutingWorkbench(evaluator, search=fresh)
    assert begun.trace is None
    assert begun.recipe == evaluator.pool.equal("a", "c")
    fresh.step()
    begun.refresh()
    assert begun.trial(0) == evaluator.pool.equal("a", "c")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda e, s: RoutingWorkbench(e, ("a", "x")), "unknown source of pool 'tiny' 'x'"),
        (lambda e, s: RoutingWorkbench(e, ("a", "b"), search=s), "search: is over the sources a, c"),
        (lambda e, s: RoutingWorkbench(e, pair="pair9"), "unknown pair of benchmark"),
        (lambda e, s: RoutingWorkbench(e, ("a",), recipe=e.pool.equal("b")), "holds the source 'b'"),
        (lambda e, s: RoutingWorkbench(e, recipe=of_another(e)), "merged from another 'a'"),
        (lambda e, s: RoutingWorkbench(e, search="nowhere.jsonl"), "no such file"),
        (lambda e, s: RoutingWorkbench(e).trial(0), "open with search="),
        (lambda e, s: RoutingWorkbench(e, search=s).trial(9), "expected 0 to 8"),
        (lambda e, s: RoutingWorkbench(e).pin("C"), "unknown pin 'C'"),
    ],
)
def test_what_is_refused(
    evaluator: Evaluator,
    searched: tuple[RoutingSearch, Path],
    make: Callable[[Evaluator, RoutingSearch], object],
    message: str,
) -> None:
    with pytest.raises(InputError, match=message):
        make(evaluator, searched[0])


def test_pins_follow_the_pair(evaluator: Evaluator) -> None:
    bench = RoutingWorkbench(evaluator)
    bench.pin("A")
    bench.history = bench.history.edit(bench.draft.weigh("neck", "a", 1.0))
    bench.choose_pair("pair1")
    images = evaluator.evaluate([evaluator.pool.uniform(), bench.recipe])
    assert bench.pins["A"].look.score == images[0].images[1].value("bad-2.0")
    assert bench.look.score == images[1].images[1].value("bad-2.0")
    bench.unpin("A")
    assert bench.pins == {}


def test_scores_go_to_the_store_and_are_flagged_where_a_report_tests(
    evaluator: Evaluator, tmp_path: Path
) -> None:
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        own = evaluator.with_store(store)
        reported = evaluator.benchmark.select(["pair1"])
        bench = RoutingWorkbench(own, tested_on=[reported])
        assert dict(bench.shared) == {"pairs": ("pair1",)}
        assert bench.known_score(bench.recipe) is None
        score = bench.score(bench.recipe)
        assert bench.known_score(bench.recipe) == score == own([bench.recipe])[0].score
        assert own.counts.computed == 0, "the evaluator itself did not have to"
        (seen,) = bench.seen_by_hand()
        assert (seen.edits, seen.pairs) == (1, ("pair1",))
        assert seen_by_hand(store, [evaluator.benchmark.select(["pair0"])])[0].edits == 1


def test_what_a_search_scored_is_no_hand_edit(evaluator: Evaluator, tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        own = evaluator.with_store(store)
        own([own.pool.uniform()])
        bench = RoutingWorkbench(own, tested_on=[evaluator.benchmark])
        bench.score(bench.recipe)
        assert bench.seen_by_hand() == ()


def test_a_stage_2_search_starts_from_an_edited_recipe(evaluator: Evaluator) -> None:
    bench = RoutingWorkbench(evaluator, ("a", "b"), tied=False)
    edited = bench.draft.weigh("neck", "a", 1.0).scale("head", 0.25).without("b")
    search = RoutingSearch(
        ("a", "b"), evaluator.pool.blocks, evaluator, RoutingSettings(tied=False), start=edited.recipe
    )
    search.step()
    equal = Recipe.equal(("a", "b"), bench.draft.blocks)
    assert [candidate.recipe for candidate in search.candidates] == [equal, edited.recipe]
