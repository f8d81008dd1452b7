"""Looks at one pair agree with the evaluator, at full size and, roughly, at a reduced one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tiny import write_pairs, write_pool

from sfkit.analysis import previews
from sfkit.analysis.previews import PairPreview, held_score, reduction_for
from sfkit.datasets.benchmark import open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.merging import open_pool


@pytest.fixture(scope="module")
def evaluator(tmp_path_factory: pytest.TempPathFactory) -> Evaluator:
    folder: Path = tmp_path_factory.mktemp("world")
    pool = open_pool(write_pool(folder / "pool", sources=2))
    return Evaluator(pool, open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0"))


def test_a_look_agrees_with_the_evaluator(evaluator: Evaluator) -> None:
    recipe = evaluator.pool.uniform()
    preview = PairPreview(evaluator, "pair1")
    look = preview.look(recipe)
    images = evaluator.evaluate([recipe])[0].images
    assert look.score == images[1].value("bad-2.0")
    assert look.reduction == 1
    assert look.disparity.shape == look.error.shape == (48, 96)
    np.testing.assert_array_equal(np.isnan(look.error), np.isnan(preview.comparand.truth))
    preview.choose("pair0")
    assert preview.look(recipe).score == images[0].value("bad-2.0")


def test_the_search_s_network_is_left_alone(evaluator: Evaluator) -> None:
    evaluator.engine.worker.model.apply(evaluator.pool.uniform())
    before = evaluator.engine.worker.model.flat.clone()
    PairPreview(evaluator).look(evaluator.pool.base_recipe())
    assert (evaluator.engine.worker.model.flat == before).all()


def test_a_slow_network_gets_a_reduced_look_first(
    evaluator: Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    preview = PairPreview(evaluator)
    full = preview.look(evaluator.pool.uniform())
    monkeypatch.setattr(previews, "QUICK_SECONDS", full.seconds / 3)
    quick = preview.quick_look(evaluator.pool.uniform())
    assert quick.reduction == 2
    assert quick.score is None
    assert quick.disparity.shape == (24, 48)
    np.testing.assert_allclose(
        quick.error, abs(quick.disparity - preview.comparand.truth[::2, ::2]), rtol=1e-5
    )
    monkeypatch.setattr(previews, "QUICK_SECONDS", math.inf)
    assert preview.quick_look(evaluator.pool.uniform()).reduction == 1


def test_the_reduction_is_a_power_of_two_and_at_most_four() -> None:
    quick = previews.QUICK_SECONDS
    seconds = (0.0, quick, 1.1 * quick, 4 * quick, 4.1 * quick, 1e9)
    assert [reduction_for(value) for value in seconds] == [1, 1, 2, 2, 4, 4]


def test_an_unknown_pair_is_refused_and_the_old_one_stays(evaluator: Evaluator) -> None:
    preview = PairPreview(evaluator, "pair1")
    with pytest.raises(InputError, match=r"unknown pair of benchmark 'pairs' 'pair9'"):
        preview.choose("pair9")
    assert preview.pair == "pair1"


def test_a_held_score_costs_nothing(evaluator: Evaluator) -> None:
    own = evaluator.with_store(type(evaluator.store)(":memory:"))
    recipe = own.pool.equal("a")
    assert held_score(own, recipe) is None
    assert own.counts.computed == 0
    score = own([recipe])[0].score
    assert held_score(own, recipe) == score
    assert held_score(own, own.pool.equal("b")) is None
