"""Stepping, iterating, stopping, and what both stages promise alike."""

from __future__ import annotations

import dataclasses
import threading

import pytest
from search_landscapes import BLOCKS, Scorer, names

from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings
from sfkit.search.scoring import score_once


def score(recipe: Recipe) -> float:
    return sum(recipe.scales) + 0.1 * len(recipe.sources) + sum(recipe.weights[0][:1])


def subset(scorer) -> SubsetSearch:
    return SubsetSearch(names(6), BLOCKS, scorer, SubsetSettings(population=6, generations=4))


def routing(scorer) -> RoutingSearch:
    return RoutingSearch(names(3), BLOCKS, scorer, RoutingSettings(evaluations=41, population=10))


pytestmark = pytest.mark.parametrize("build", [subset, routing])


def test_nothing_happens_before_the_first_step(build) -> None:
    scorer = Scorer(score)
    search = build(scorer)
    assert (search.generation, search.done, search.best, search.candidates) == (-1, False, None, ())
    assert search.archive() == ()
    assert search.counts.candidates == 0
    assert scorer.calls == []


def test_steps_count_up_and_the_last_says_it_is_done(build) -> None:
    search = build(Scorer(score))
    generations = list(search)
    assert [generation.number for generation in generations] == [0, 1, 2, 3, 4]
    assert [generation.done for generation in generations] == [False] * 4 + [True]
    assert sum((generation.candidates for generation in generations), ()) == search.candidates
    assert generations[-1].best == search.best
    assert generations[-1].counts == search.counts
    assert generations[-1].reason == search.reason
    with pytest.raises(InputError, match=r"no step is left .*make a new search to go on"):
        search.step()


def test_stepping_iterating_and_running_are_the_same_search(build) -> None:
    stepped, iterated, run = (build(Scorer(score)) for _ in range(3))
    while not stepped.done:
        stepped.step()
    seen = []
    assert run.run(seen.append) == iterated.best if list(iterated) else False
    assert stepped.candidates == iterated.candidates == run.candidates
    assert [generation.number for generation in seen] == [0, 1, 2, 3, 4]
    assert list(iterated) == []


def test_the_best_never_gets_worse(build) -> None:
    scores = [generation.best.fitness for generation in build(Scorer(score))]
    assert scores == sorted(scores, reverse=True)


def test_a_stop_from_another_thread_ends_between_generations(build) -> None:
    holding, asked = threading.Event(), threading.Event()

    class Waiting(Scorer):
        def __call__(self, recipes):
            holding.set()
            assert asked.wait(300)
            return super().__call__(recipes)

    search = build(Waiting(score))
    thread = threading.Thread(target=search.run)
    thread.start()
    assert holding.wait(300)
    with pytest.raises(SfkitError, match="another thread is stepping it"):
        search.step()
    assert search.generation == -1
    search.request_stop()
    asked.set()
    thread.join(300)
    assert not thread.is_alive()
    assert (search.generation, search.done) == (0, False)
    other = build(Scorer(score))
    assert search.run() == other.run()
    assert search.candidates == other.candidates


def test_a_stop_before_anything_was_scored_is_said(build) -> None:
    search = build(Scorer(score))
    search.request_stop()
    with pytest.raises(SfkitError, match="stopped before its first candidate was scored"):
        search.run()
    assert search.run() == search.best


def test_an_error_of_the_scorer_leaves_the_state_as_it_was(build) -> None:
    class Broken(Scorer):
        broken = True

        def __call__(self, recipes):
            if self.broken and len(self.calls) == 2:
                raise RuntimeError("the disk is full")
            return super().__call__(recipes)

    search, whole = build(Broken(score)), build(Scorer(score))
    with pytest.raises(RuntimeError, match="the disk is full"):
        search.run()
    assert search.generation == 1
    search.scorer.broken = False
    assert search.run() == whole.run()
    assert search.candidates == whole.candidates


def test_a_scorer_that_loses_an_outcome_is_told(build) -> None:
    search = build(lambda recipes: [Outcome(1.0)] * (len(recipes) + 1))
    with pytest.raises(SfkitError, match=r"scorer: found \d+ outcomes for \d+ recipes"):
        search.step()
    assert search.generation == -1


def test_states_and_candidates_are_frozen(build) -> None:
    search = build(Scorer(score))
    search.step()
    before = search.state
    for record, field in ((before, "generation"), (before.candidates[0], "number")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, field, 7)
    search.step()
    assert before.generation == 0
    assert search.state.candidates[: len(before.candidates)] == before.candidates


def test_equal_recipes_in_one_generation_are_asked_for_once(build) -> None:
    search = build(Scorer(score))
    search.step()
    known, scorer = search.candidates[0].recipe, Scorer(score)
    new = Recipe.weighted({"source0": 0.5, "source1": 0.5}, BLOCKS, scale=1.5)
    heard = score_once(search.candidates, [new, known, new], scorer)
    assert scorer.calls == [(new,)]
    assert [entry.repeated for entry in heard] == [False, True, True]
    assert heard[1].outcome is search.candidates[0].outcome
    assert score_once(search.candidates, [known], scorer)[0].repeated
    assert len(scorer.calls) == 1
