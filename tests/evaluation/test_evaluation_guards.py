"""Stage 2 chosen on held-out pairs, and averaged over folds, on networks whose output is known by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flat_world import benchmark, flat_pool

from sfkit.analysis.routings import routing_trace, watched_routing
from sfkit.errors import SfkitWarning
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.holdout import deal
from sfkit.merging import Pool, Recipe
from sfkit.search import Journal, LiveSearch, RoutingSearch, RoutingSettings, read_journal
from sfkit.search.routing_records import RoutingCandidate

LEVELS = {"low": 2.0, "high": 6.0}
EQUAL = 4.0
"""Level of the equal merge, in pixels."""


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"), LEVELS)


def truths(pairs: int, holdout: float, guiding: float, held: float, seed: int = 0) -> tuple[float, ...]:
    """Ground truth of every pair: one value where it guides, another where it is held out."""
    ((out, *_),) = deal([pairs], holdout, seed)
    return tuple(held if image in out else guiding for image in range(pairs))


def level(candidate: RoutingCandidate) -> float:
    """The disparity everywhere: base + gamma * sum of weighted task vectors, in pixels."""
    weights, scale = candidate.recipe.of("level")
    return 5.0 + scale * (weights["low"] * (2.0 - 5.0) + weights["high"] * (6.0 - 5.0))


def searched(
    pool: Pool, values: tuple[float, ...], store: EvaluationStore | None = None, **options
) -> RoutingSearch:
    scorer = Evaluator(pool, benchmark(truths=values, metric="epe"), store=store)
    settings = RoutingSettings(**{"evaluations": 60, "converge": False, **options})
    return RoutingSearch(("low", "high"), pool.blocks, scorer, settings)


def trace(search: RoutingSearch) -> list[object]:
    return [(c.x, c.fitness, c.held, c.criterion, c.fold, c.origin) for c in search.candidates]


def test_what_guides_and_what_chooses_by_hand(pool: Pool) -> None:
    search = searched(pool, truths(6, 0.5, guiding=5.5, held=4.5), holdout=0.5)
    best = search.run()
    for candidate in search.candidates:
        assert candidate.guiding == candidate.fitness == pytest.approx(abs(level(candidate) - 5.5), abs=1e-5)
        assert candidate.held == candidate.criterion == pytest.approx(abs(level(candidate) - 4.5), abs=1e-5)
        assert candidate.score == pytest.approx((candidate.guiding + candidate.held) / 2)
    assert best.held == min(c.held for c in search.candidates)
    assert level(best) == pytest.approx(4.5, abs=0.15)
    followed = [level(candidate) for candidate in search.candidates[-search.population :]]
    assert np.mean(followed) == pytest.approx(5.5, abs=0.25), "CMA-ES sees no held-out pair"


def test_where_the_held_out_pairs_only_get_worse_stage_1_is_kept(pool: Pool) -> None:
    values = truths(8, 0.25, guiding=5.5, held=EQUAL)
    plain = searched(pool, values).run()
    assert level(plain) > 4.3, "the pairs that guide it have moved the plain search"
    guarded = searched(pool, values, holdout=0.25)
    best = guarded.run()
    assert (best.number, best.recipe) == (0, Recipe.equal(("low", "high"), pool.blocks))
    assert min(c.fitness for c in guarded.candidates) < guarded.candidates[0].fitness - 0.5


@pytest.mark.parametrize("holdout", [0.25, 0.5, 2, 4])
def test_no_guard_chooses_worse_than_x_0(pool: Pool, holdout: float) -> None:
    for seed in range(3):
        search = searched(pool, (3.0, 7.0, 4.5, 3.5, 6.0), holdout=holdout, seed=seed, evaluations=41)
        best = search.run()
        assert best.criterion <= search.candidates[0].criterion
        assert len(search.candidates) == 41
        assert set(search.candidates[0].x) == {0.0}


def test_folds_take_turns_and_end_with_the_mean_of_what_they_found(pool: Pool) -> None:
    values = (4.5, 5.5, 5.0, 6.0, 5.25)
    search = searched(pool, values, holdout=2, evaluations=50)
    best = search.run()
    ((first, second),) = deal([5], 2, 0)
    for candidate in search.candidates[1:-1]:
        assert candidate.fold == (candidate.generation - 1) % 2
        held = [abs(level(candidate) - values[image]) for image in (first, second)[candidate.fold]]
        assert candidate.held == pytest.approx(np.mean(held), abs=1e-5)
    winners = []
    for fold, images in enumerate((first, second)):
        at_zero = np.mean([abs(EQUAL - values[image]) for image in images])
        found = min((c for c in search.candidates if c.fold == fold), key=lambda c: c.held)
        assert found.criterion - search.candidates[0].score == pytest.approx(found.held - at_zero, abs=1e-5)
        winners.append(found.x)
    average = search.candidates[-1]
    assert (average.origin, average.fold) == ("average", None)
    assert average.x == pytest.approx(np.mean(winners, axis=0))
    assert average.recipe == search.encoding.decode(np.array(average.x))
    assert best is average
    assert best.score < search.candidates[0].score


def test_folds_that_disagree_cancel(pool: Pool) -> None:
    ((first, _),) = deal([4], 2, 0)
    values = tuple(5.5 if image in first else 2.5 for image in range(4))
    search = searched(pool, values, holdout=2, evaluations=80)
    search.run()
    assert abs(level(search.candidates[-1]) - EQUAL) < 0.4


@pytest.mark.parametrize("holdout", [0.5, 3])
def test_a_guarded_search_resumes_through_the_store_and_repeats_nothing(
    pool: Pool, holdout: float, tmp_path: Path
) -> None:
    values = (4.5, 5.5, 5.0, 6.0, 3.5)
    whole = searched(pool, values, holdout=holdout)
    whole.run()
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        killed = searched(pool, values, store, holdout=holdout)
        for _ in range(4):
            killed.step()
        before = len(store)
        again = searched(pool, values, store, holdout=holdout)
        again.run()
        assert again.counts.cached == before
        assert trace(again) == trace(whole)
        plain = searched(pool, values, store)
        plain.step()
        plain.step()
        assert plain.counts.cached >= 2, "evaluations are the same with a hold-out and without"


@pytest.mark.parametrize(("holdout", "after"), [(0.5, 30), (3, 30), (3, 59)])
def test_a_guarded_step_that_was_interrupted_can_be_taken_again(
    pool: Pool, holdout: float, after: int
) -> None:
    """After 59 of 60 evaluations only the folds' average is left, behind a population that was cut."""
    values = (4.5, 5.5, 5.0, 6.0, 3.5)
    whole, broken = (searched(pool, values, holdout=holdout) for _ in range(2))
    whole.run()
    while len(broken.candidates) < after:
        broken.step()
    scorer = broken._scorer

    def interrupt(recipes):
        raise KeyboardInterrupt

    broken._scorer = interrupt
    with pytest.raises(KeyboardInterrupt):
        broken.step()
    broken._scorer = scorer
    broken.run()
    assert trace(broken) == trace(whole)


def test_a_live_session_and_the_journal_tell_of_the_held_out_score(pool: Pool, tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    values = truths(6, 0.5, guiding=5.5, held=4.5)
    scorer = Evaluator(pool, benchmark(truths=values, metric="epe"))
    settings = RoutingSettings(evaluations=30, holdout=0.5)
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, settings, journal=Journal(journal))
    live = LiveSearch(search)
    live.run()
    live.wait(timeout=300)
    start, *rest = read_journal(journal)
    assert (start["settings"]["holdout"], start["folds"]) == (0.5, 1)
    told = [entry for record in rest if record["event"] == "generation" for entry in record["candidates"]]
    assert [entry["held"] for entry in told] == [c.held for c in search.candidates]
    history = search.history
    assert history["held"].tolist() == [c.held for c in search.candidates]
    assert (history["penalised"] == history["guiding"]).all()


@pytest.mark.parametrize("holdout", [0.5, 3])
def test_traces_lead_to_what_was_chosen(pool: Pool, holdout: float, tmp_path: Path) -> None:
    scorer = Evaluator(pool, benchmark(truths=(4.5, 5.5, 5.0, 6.0, 3.5), metric="epe"))
    journal = tmp_path / "journal.jsonl"
    settings = RoutingSettings(evaluations=40, holdout=holdout)
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, settings, journal=Journal(journal))
    for _ in range(3):
        search.step()
    assert routing_trace(search).best == search.best.number
    search.run()
    assert routing_trace(search).best == search.best.number
    assert watched_routing(read_journal(journal)).best == search.best.number


def test_too_few_pairs_warn_and_search_as_the_paper_does(pool: Pool) -> None:
    with pytest.warns(SfkitWarning, match="found 3 validation pairs"):
        guarded = searched(pool, (4.5, 5.5, 5.0), holdout=0.5)
    plain = searched(pool, (4.5, 5.5, 5.0))
    guarded.run()
    plain.run()
    assert trace(guarded) == trace(plain)
