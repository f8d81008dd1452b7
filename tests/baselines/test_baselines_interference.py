"""TIES and DARE on networks of one parameter, whose scores can be worked out on paper."""

from __future__ import annotations

from statistics import mean, stdev

import pytest
from flat_world import benchmark, flat_pool

from sfkit import baselines
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.merging import Pool

# Levels in pixels, of a base of 5 px: task vectors of -1, 7 and 4 px.
LEVELS = {"a": 4.0, "b": 12.0, "c": 9.0}


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"), LEVELS)


@pytest.fixture(scope="module")
def eights(pool: Pool) -> Evaluator:
    """End-point error of scenes whose true disparity is 8 px."""
    return Evaluator(pool, benchmark("eights", (8.0, 8.0), metric="epe"), store=EvaluationStore(":memory:"))


def test_ties_elects_plus_and_finds_the_strength(pool: Pool, eights: Evaluator) -> None:
    """-1 + 7 + 4 elects plus, whose mean is 5.5; half of it from 5 px is off by a quarter."""
    found = baselines.ties(pool, eights)
    assert found.settings == {"density": 0.1, "lambda": 0.5}
    assert found.score == pytest.approx(0.25, abs=1e-6)
    assert found.pool.names == ("ties",)
    untuned = baselines.ties(pool, eights, densities=(0.2,), lambdas=(1.0,))
    assert untuned.score == pytest.approx(2.5, abs=1e-6)
    assert untuned.evaluations == 1


def test_dare_without_dropping_is_uniform(pool: Pool, eights: Evaluator) -> None:
    found = baselines.dare(pool, eights, probabilities=(0.0,), draws=2)
    assert found.score == pytest.approx(baselines.uniform(pool, eights).score, abs=1e-6)
    assert found.note.endswith("± 0.000 over 2 draws")


def test_dare_tells_mean_and_spread_of_its_draws(pool: Pool, eights: Evaluator) -> None:
    found = baselines.dare(pool, eights, probabilities=(0.5,), draws=6, seed=1)
    scores = list(found.history["score"])
    assert len(found.draws) == 6
    assert found.draws[0].recipe == found.recipe
    assert found.note == f"validation {mean(scores):.3f} ± {stdev(scores):.3f} over 6 draws"
    # Each source's step of -1, 7, 4 px is dropped or doubled; the mean of three is added to 5 px.
    possible = {abs(5 + (2 * (-a + 7 * b + 4 * c)) / 3 - 8) for a in (0, 1) for b in (0, 1) for c in (0, 1)}
    assert all(min(abs(score - value) for value in possible) < 1e-5 for score in scores)
    assert len(set(scores)) > 1
    again = baselines.dare(pool, eights, probabilities=(0.5,), draws=6, seed=1)
    assert list(again.history["score"]) == scores
    assert (
        list(baselines.dare(pool, eights, probabilities=(0.5,), draws=6, seed=2).history["score"]) != scores
    )


def test_dare_ties_without_dropping_is_ties(pool: Pool, eights: Evaluator) -> None:
    dare = baselines.dare_ties(pool, eights, probabilities=(0.0,), lambdas=(0.5,), draws=1)
    assert dare.score == pytest.approx(0.25, abs=1e-6)
    assert dare.pool.identity.values() != pool.identity.values()


def test_an_empty_grid_is_refused(pool: Pool, eights: Evaluator) -> None:
    with pytest.raises(InputError, match="densities: found an empty grid"):
        baselines.ties(pool, eights, densities=())
    with pytest.raises(InputError, match="lambdas: found an empty grid"):
        baselines.dare(pool, eights, lambdas=())
    with pytest.raises(InputError, match="draws: found 0"):
        baselines.dare(pool, eights, draws=0)
