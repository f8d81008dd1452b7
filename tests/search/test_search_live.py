"""A search in its own thread finds what it would have found, however it is paused, stepped and stopped."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_landscapes import BLOCKS, Scorer, names, subset_landscape
from tiny import write_pairs, write_pool

from sfkit import (
    CombinedScorer,
    Evaluator,
    Journal,
    Pool,
    RoutingSearch,
    RoutingSettings,
    SubsetSearch,
    open_benchmark,
    open_pool,
)
from sfkit import SubsetSettings as Settings
from sfkit.datasets.benchmark import Benchmark
from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.store import Evaluation
from sfkit.merging.recipe import Recipe
from sfkit.search.journal import read_journal
from sfkit.search.live import LiveSearch
from sfkit.search.progress import Phase

PATIENCE = 300.0
SMALL = Settings(population=6, generations=3, seed=1)


class Gated(Evaluator):
    """Every evaluation waits for a permit, so that a test knows how far a search can be."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.permits = threading.Semaphore(0)

    def open(self) -> None:
        """Let everything pass."""
        self.permits.release(10_000)

    def evaluate(
        self, recipes: Sequence[Recipe], *, progress: Callable[[int, int], None] | None = None
    ) -> list[Evaluation]:
        """Hear of an evaluation only with a permit."""

        def gated(done: int, every: int) -> None:
            assert self.permits.acquire(timeout=PATIENCE)
            assert progress is not None
            progress(done, every)

        return super().evaluate(recipes, progress=None if progress is None else gated)


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return open_pool(write_pool(tmp_path_factory.mktemp("pool"), sources=5))


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    return open_benchmark("pairs", write_pairs(tmp_path_factory.mktemp("pairs")))


def subsets(pool: Pool, scorer: Any, journal: Journal | None = None) -> SubsetSearch:
    return SubsetSearch(pool.names, pool.blocks, scorer, SMALL, journal=journal)


def trace(search: SubsetSearch) -> list[tuple[Any, ...]]:
    """Everything a search decides, and where its scores came from."""
    return [
        (c.chromosome, c.parents, c.operators, c.score, c.repeated, c.outcome.cached)
        for c in search.candidates
    ]


def until(live: LiveSearch, phase: Phase) -> None:
    live.wait(lambda progress: progress.phase is phase, PATIENCE)


@pytest.fixture(scope="module")
def undisturbed(pool: Pool, pairs: Benchmark) -> list[tuple[Any, ...]]:
    search = subsets(pool, Evaluator(pool, pairs))
    search.run()
    return trace(search)


def test_it_runs_to_the_end(pool: Pool, pairs: Benchmark, undisturbed: list[tuple[Any, ...]]) -> None:
    search = subsets(pool, Evaluator(pool, pairs))
    live = LiveSearch(search)
    assert live.progress().phase is Phase.READY
    assert live.metric == pairs.metric
    live.run()
    progress = live.wait(timeout=PATIENCE)
    assert progress.phase is Phase.FINISHED
    assert progress.candidates == progress.total == 24
    assert progress.counts == search.counts
    assert progress.best is not None
    assert progress.best.score == search.best.score
    assert (progress.generation, progress.generations, progress.left) == (3, 3, None)
    assert trace(search) == undisturbed
    live.run()
    assert live.progress().phase is Phase.FINISHED


def test_a_pause_holds_inside_a_generation_and_leaves_the_evaluator_free(
    pool: Pool, pairs: Benchmark, undisturbed: list[tuple[Any, ...]]
) -> None:
    evaluator = Gated(pool, pairs)
    search = subsets(pool, evaluator)
    live = LiveSearch(search)
    live.run()
    evaluator.permits.release(3)  # the look into the store, and two evaluations
    live.wait(lambda progress: progress.counts.distinct == 2, PATIENCE)
    live.pause()
    assert live.progress().phase is Phase.PAUSING
    evaluator.permits.release()
    until(live, Phase.PAUSED)
    assert live.progress().counts.distinct == 3
    assert search.generation == -1
    assert len(evaluator([pool.base_recipe()])) == 1  # in this thread, while the other one holds
    evaluator.open()
    live.run()
    assert live.wait(timeout=PATIENCE).phase is Phase.FINISHED
    assert trace(search) == undisturbed


def test_what_was_in_the_store_before_a_pause_counts_as_cached(pool: Pool, pairs: Benchmark) -> None:
    first = subsets(pool, Evaluator(pool, pairs)).step().candidates
    known = {first[0].recipe, first[1].recipe}
    fresh = Gated(pool, pairs)
    fresh.evaluate(list(known))
    search = subsets(pool, fresh)
    live = LiveSearch(search)
    live.step()
    fresh.permits.release(2)
    live.wait(lambda progress: progress.counts.distinct == 3, PATIENCE)
    live.pause()
    fresh.permits.release()
    until(live, Phase.PAUSED)
    assert live.progress().counts.cached == 2
    fresh.open()
    live.step()
    live.wait(lambda progress: progress.generation == 0, PATIENCE)
    assert search.counts.cached == 2
    assert {c.recipe for c in search.candidates if c.outcome.cached} == known


def test_a_stop_breaks_off_and_running_again_ends_the_same(
    pool: Pool, pairs: Benchmark, undisturbed: list[tuple[Any, ...]], tmp_path: Path
) -> None:
    evaluator = Gated(pool, pairs)
    search = subsets(pool, evaluator, Journal(tmp_path / "journal.jsonl"))
    live = LiveSearch(search)
    live.step()
    evaluator.permits.release(3)
    live.wait(lambda progress: progress.counts.distinct == 2, PATIENCE)
    live.stop()
    assert live.progress().phase is Phase.STOPPING
    evaluator.permits.release()
    until(live, Phase.STOPPED)
    assert search.candidates == ()
    assert [record["event"] for record in read_journal(tmp_path / "journal.jsonl")] == ["start", "end"]
    evaluator.open()
    live.run()
    assert live.wait(timeout=PATIENCE).phase is Phase.FINISHED
    assert [row[:-1] for row in trace(search)] == [row[:-1] for row in undisturbed]
    assert search.counts.cached == 3


def test_a_step_is_one_generation(pool: Pool, pairs: Benchmark) -> None:
    search = subsets(pool, Evaluator(pool, pairs))
    live = LiveSearch(search)
    for generation in range(3):
        live.step()
        live.wait(lambda now, reached=generation: now.generation == reached and now.settled, PATIENCE)
        assert live.progress().phase is Phase.PAUSED
    live.stop()
    until(live, Phase.STOPPED)
    assert search.step().number == 3  # by hand, once the thread has let go
    assert live.progress().phase is Phase.FINISHED


def test_combined_benchmarks_are_heard_of(pool: Pool, pairs: Benchmark) -> None:
    scorer = CombinedScorer([Evaluator(pool, pairs), Evaluator(pool, pairs)])
    search = RoutingSearch(pool.names, pool.blocks, scorer, RoutingSettings(evaluations=8, seed=1))
    live = LiveSearch(search)
    heard: list[int] = []
    live.run()
    live.wait(lambda now: heard.append(now.candidates) or now.settled, PATIENCE)
    assert live.metric == pairs.metric
    assert search.done
    assert heard == sorted(heard)
    assert heard[-1] == 8


class Breaking(Scorer):
    """Fails as a whole while it is told to."""

    broken = True

    def __call__(self, recipes: Sequence[Recipe]) -> list[Any]:
        if self.broken:
            raise OSError("the disk is full")
        return super().__call__(recipes)


def landscape(kind: type[Scorer] = Scorer) -> Scorer:
    score = subset_landscape(6, 0)
    return kind(lambda recipe: score(recipe.sources))


def test_what_the_scorer_raises_is_told_and_run_tries_again() -> None:
    scorer = landscape(Breaking)
    search = SubsetSearch(names(6), BLOCKS, scorer, SMALL)
    live = LiveSearch(search)
    live.run()
    progress = live.wait(timeout=PATIENCE)
    assert (progress.phase, progress.error) == (Phase.FAILED, "OSError: the disk is full")
    scorer.broken = False
    live.run()
    progress = live.wait(timeout=PATIENCE)
    assert (progress.phase, progress.error) == (Phase.FINISHED, None)


def test_an_interrupt_of_the_main_thread_does_not_reach_it(pool: Pool, pairs: Benchmark) -> None:
    evaluator = Gated(pool, pairs)
    live = LiveSearch(subsets(pool, evaluator))
    live.run()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    evaluator.open()
    assert live.wait(timeout=PATIENCE).phase is Phase.FINISHED


def test_a_search_has_one_session_and_one_thread() -> None:
    search = SubsetSearch(names(6), BLOCKS, landscape(), SMALL)
    live = LiveSearch.of(search)
    assert LiveSearch.of(search) is live
    assert LiveSearch.of(SubsetSearch(names(6), BLOCKS, landscape(), SMALL)) is not live
    live.step()
    live.wait(lambda progress: progress.phase is Phase.PAUSED, PATIENCE)
    live.run()
    live.wait(timeout=PATIENCE)
    with pytest.raises(InputError, match="no step is left"):
        search.step()


def test_another_thread_that_steps_is_an_error_that_is_told() -> None:
    inside, leave = threading.Event(), threading.Event()

    def slow(recipe: Recipe) -> float:
        inside.set()
        assert leave.wait(PATIENCE)
        return 1.0

    search = SubsetSearch(names(6), BLOCKS, Scorer(slow), SMALL)
    by_hand = threading.Thread(target=search.step)
    by_hand.start()
    assert inside.wait(PATIENCE)
    live = LiveSearch(search)
    live.run()
    progress = live.wait(timeout=PATIENCE)
    leave.set()
    by_hand.join(PATIENCE)
    assert progress.phase is Phase.FAILED
    assert "another thread is stepping it" in str(progress.error)


def test_waiting_ends_in_time() -> None:
    live = LiveSearch(SubsetSearch(names(6), BLOCKS, landscape(), SMALL))
    with pytest.raises(SfkitError, match=r"still ready after 0.01 s"):
        live.wait(lambda progress: progress.phase is Phase.FINISHED, timeout=0.01)


@settings(max_examples=25)
@given(st.lists(st.sampled_from(["run", "pause", "step", "stop"]), max_size=8))
def test_no_order_of_commands_changes_the_outcome(commands: list[str]) -> None:
    plain = SubsetSearch(names(6), BLOCKS, landscape(), SMALL)
    plain.run()
    search = SubsetSearch(names(6), BLOCKS, landscape(), SMALL)
    live = LiveSearch(search)
    for command in commands:
        getattr(live, command)()
    live.wait(timeout=PATIENCE)
    live.run()
    live.wait(lambda progress: progress.phase is Phase.FINISHED, PATIENCE)
    assert trace(search) == trace(plain)
