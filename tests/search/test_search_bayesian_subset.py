"""Stage 1 by a model, on landscapes whose optimum is known in full."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from search_landscapes import BLOCKS, Scorer, every_subset, names, subset_landscape

from sfkit.errors import InputError
from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe, routed
from sfkit.search import Constraints, Journal, LiveSearch, read_journal
from sfkit.search.acquisition import equal_weights, listed, smallest_bound
from sfkit.search.bayesian_settings import BayesianSubsetSettings
from sfkit.search.bayesian_subset import BayesianSubsetSearch
from sfkit.search.operators import SubsetSpace
from sfkit.search.progress import watched_progress

QUICK = BayesianSubsetSettings(population=6, generations=10)


def scorer_of(count: int, seed: int) -> Scorer:
    score = subset_landscape(count, seed)
    return Scorer(lambda recipe: score(recipe.sources))


def searched(
    scorer: Scorer, count: int, settings: BayesianSubsetSettings = QUICK, **more: object
) -> BayesianSubsetSearch:
    search = BayesianSubsetSearch(names(count), BLOCKS, scorer, settings, **more)  # type: ignore[arg-type]
    search.run()
    return search


@pytest.mark.parametrize("batch", [1, 4])
def test_it_finds_the_best_of_all_subsets_and_scores_none_twice(batch: int) -> None:
    scorer, score = scorer_of(6, 3), subset_landscape(6, 3)
    search = searched(scorer, 6, BayesianSubsetSettings(population=6, generations=24 // batch, batch=batch))
    assert search.best is not None
    assert search.best.score == min(score(subset) for subset in every_subset(6))
    assert len(set(scorer.asked)) == len(scorer.asked) == search.counts.distinct


def test_a_source_alone_is_scored_and_wins_nothing() -> None:
    search = searched(Scorer(lambda recipe: float(len(recipe.sources))), 4)
    assert [c.subset for c in search.candidates[:4]] == [(name,) for name in names(4)]
    assert search.best is not None
    assert len(search.best.subset) == 2
    assert all(len(one.subset) >= 2 for one in search.population)


def test_the_same_seed_and_scores_give_the_same_search_whatever_happened_between() -> None:
    whole = searched(scorer_of(8, 1), 8)
    other = BayesianSubsetSearch(names(8), BLOCKS, scorer_of(8, 1), QUICK)
    failing = True

    def broken(recipes: Sequence[Recipe]) -> list[Outcome]:
        nonlocal failing
        failing = not failing
        if failing:
            raise KeyboardInterrupt
        return scorer_of(8, 1)(recipes)

    with other.scored_by(broken):
        while not other.done:
            try:
                other.step()
            except KeyboardInterrupt:
                continue
    assert other.state == whole.state


def test_what_is_known_is_taken_up_and_what_is_no_subset_only_teaches() -> None:
    score = subset_landscape(7, 2)
    every = every_subset(7)
    best = min(every, key=score)
    known = [Known(Recipe.equal(sorted(subset), BLOCKS), score(subset)) for subset in every[::4]]
    known.append(Known(Recipe.equal(sorted(best), BLOCKS), score(best), "hand edit"))
    known.append(Known(routed(names(7)[:2], BLOCKS, [(0.9, 0.1)] * 3, (0.5, 1.0, 1.0)), 9.0, "hand edit"))
    known.append(Known(Recipe.equal(names(7)[:1], BLOCKS), score(names(7)[:1])))
    search = BayesianSubsetSearch(names(7), BLOCKS, scorer_of(7, 2), QUICK, known=known)
    search.step()
    assert [entry.origin for entry in search._others] == ["hand edit"], "what is a candidate teaches once"
    taken = [c for c in search.candidates if c.operators == ("known",)]
    assert len(taken) == len({k.recipe for k in known}) - 2
    assert search.best is not None
    assert set(search.best.subset) == best
    search.step()
    assert search.candidates[-1].operators == ("model",)


def test_an_unknown_source_among_what_is_known_is_refused() -> None:
    known = [Known(Recipe.equal(["elsewhere"], BLOCKS), 1.0)]
    with pytest.raises(InputError, match="unknown source 'elsewhere'"):
        BayesianSubsetSearch(names(4), BLOCKS, scorer_of(4, 0), known=known)


def test_constraints_hold_for_every_subset() -> None:
    limits = Constraints(include=(names(7)[2],), exclude=(names(7)[5],), largest=4)
    search = searched(scorer_of(7, 5), 7, constraints=limits)
    subsets = [c.subset for c in search.candidates if c.operators != ("single",)]
    assert all(names(7)[2] in s and names(7)[5] not in s and len(s) <= 4 for s in subsets)
    assert all(c.subset != (names(7)[5],) for c in search.candidates)


def test_it_ends_when_nothing_is_left_to_score() -> None:
    search = searched(scorer_of(4, 0), 4, BayesianSubsetSettings(population=4, generations=30, batch=3))
    assert search.reason == "all 11 subsets are scored"
    assert search.counts.distinct == 15


def test_failures_lose_and_a_search_of_failures_goes_on_by_chance() -> None:
    def score(recipe: Recipe) -> float:
        return math.inf if names(6)[0] in recipe.sources else float(len(recipe.sources))

    search = searched(Scorer(score), 6)
    assert search.best is not None
    assert names(6)[0] not in search.best.subset
    hopeless = BayesianSubsetSearch(names(5), BLOCKS, Scorer(lambda _: math.inf), QUICK)
    for _ in hopeless:
        pass
    assert hopeless.best is None
    assert {c.operators for c in hopeless.candidates if c.generation} == {("random",)}


def test_the_history_tells_what_was_foretold() -> None:
    search = searched(scorer_of(6, 4), 6)
    table = search.history
    assert table["predicted_mean"].isna().sum() == search.initial
    told = table.dropna(subset=["predicted_mean"])
    bound = told["predicted_mean"] - search.settings.beta * told["predicted_sd"]
    assert np.allclose(bound, told["acquisition"], atol=1e-6)
    error = (told["score"] - told["predicted_mean"]).abs()
    assert (error <= 4.0 * told["predicted_sd"] + 0.05).mean() > 0.8


def test_progress_counts_what_there_will_be(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    search = BayesianSubsetSearch(names(6), BLOCKS, scorer_of(6, 4), QUICK, journal=Journal(journal))
    assert LiveSearch(search).progress().total == 6 + 6 + 10
    search.run()
    assert len(search.candidates) == search.most == 22
    assert watched_progress(read_journal(journal), "subset").total == 22


def test_large_spaces_are_looked_through_by_genetic_operators() -> None:
    space, rng = SubsetSpace.free(14), np.random.default_rng(0)
    target = rng.random(14) / 6.0

    def bound(weights: np.ndarray) -> np.ndarray:
        return np.asarray(np.sum((weights - target) ** 2, axis=1))

    values = bound(equal_weights(listed(space), 14))
    found = smallest_bound(bound, space, 14, set(), [], rng)
    better = np.sum(values < bound(equal_weights([found], 14))[0])
    assert space.subsets > 4096
    assert better <= 0.001 * space.subsets


def test_what_is_left_of_a_large_space_is_found_where_the_operators_meet_nothing_new() -> None:
    space = SubsetSpace.free(13)
    every = listed(space)
    left = set(every[5::409])
    met = set(every) - left
    target = np.random.default_rng(1).random(13) / 6.0

    def bound(weights: np.ndarray) -> np.ndarray:
        return np.asarray(np.sum((weights - target) ** 2, axis=1))

    assert space.subsets == 8178
    assert len(left) == 20
    ordered = sorted(left)
    lowest = ordered[int(np.argmin(bound(equal_weights(ordered, 13))))]
    found = [smallest_bound(bound, space, 13, met, [], np.random.default_rng(seed)) for seed in range(20)]
    assert set(found) <= left
    assert lowest in found, "where the operators meet none, all that are left are looked through"


def test_a_large_space_is_searched_to_its_end() -> None:
    pool, limits = names(13), Constraints(largest=7)
    space = SubsetSpace(tuple(range(13)), frozenset(), 7)
    every = [tuple(pool[gene] for gene in genes) for genes in listed(space)]
    left = {every[7], every[3001], every[-40], every[-1]}

    def score(sources: Sequence[str]) -> float:
        return abs(sum(pool.index(name) - 4.5 for name in sources))

    known = [Known(Recipe.equal(subset, ("all",)), score(subset)) for subset in every if subset not in left]
    settings = BayesianSubsetSettings(population=6, generations=len(left) + 5, singles=False)
    scorer = Scorer(lambda recipe: score(recipe.sources))
    search = BayesianSubsetSearch(pool, ("all",), scorer, settings, constraints=limits, known=known)
    search.run()
    assert search.reason == "all 5798 subsets are scored"
    asked = [frozenset(recipe.sources) for recipe in scorer.asked]
    assert len(asked) == len(every)
    assert set(asked) == set(map(frozenset, every))
    assert set(asked[-len(left) :]) == set(map(frozenset, left))


def test_a_space_that_cannot_be_listed_is_searched() -> None:
    limits = Constraints(include=(names(30)[3],), exclude=(names(30)[7],), largest=12)
    settings = BayesianSubsetSettings(population=6, generations=4, batch=2, seed=5)

    def tried() -> tuple[Scorer, BayesianSubsetSearch]:
        scorer = Scorer(lambda recipe: sum(int(name in recipe.sources) for name in names(30)[:5]) - 2.5)
        return scorer, searched(scorer, 30, settings)

    (scorer, search), (_, again) = tried(), tried()
    assert search.space.subsets == 2**30 - 31
    assert again.state == search.state
    proposed = [c for c in search.candidates if c.generation]
    assert {c.operators for c in proposed} == {("model",)}
    assert len(proposed) == 8
    assert len(set(scorer.asked)) == len(scorer.asked) == 30 + 6 + 8
    assert all(2 <= len(set(c.subset)) == len(c.subset) and set(c.subset) <= set(names(30)) for c in proposed)
    bound_by = searched(scorer_of(30, 2), 30, settings, constraints=limits)
    within = [c.subset for c in bound_by.candidates if c.generation]
    assert all(names(30)[3] in s and names(30)[7] not in s and len(s) <= 12 for s in within)
