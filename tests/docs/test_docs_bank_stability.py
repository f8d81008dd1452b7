"""How alike halves rank: by hand from stored scores, and which subsets are asked."""

from __future__ import annotations

import numpy as np
import pytest
from bank_stability import drawn_subsets, rank_stability
from scipy.stats import spearmanr

import sfkit
from sfkit import bank
from sfkit.evaluation import EvaluationStore, Evaluator


def test_subsets_are_different_and_all_where_there_are_few() -> None:
    assert sorted(drawn_subsets(["a", "b"])) == [("a",), ("a", "b"), ("b",)]
    drawn = drawn_subsets([f"source-{i}" for i in range(11)])
    assert len(set(drawn)) == 64
    assert 4.5 < np.mean([len(subset) for subset in drawn]) < 6.5
    assert drawn == drawn_subsets([f"source-{i}" for i in range(11)])


def test_two_pairs_have_one_split_and_its_correlation_is_spearmans() -> None:
    pool = sfkit.open_pool("bank")
    with EvaluationStore(":memory:") as store:
        found = rank_stability(pool, of="bank", store=store, subsets=4, pairs=2, counts=(2, 40))
        assert list(found.index) == list(bank.benchmarks())
        assert list(found.columns) == [2]  # there are not 40
        recipes = [pool.equal(*subset) for subset in drawn_subsets(pool.names, 4)]
        scorer = Evaluator(pool, bank.benchmark("hazy-road").first(2), store=store)
        images = [[scorer.score([image]) for image in e.images] for e in scorer.evaluate(recipes)]
    first, second = np.array(images).T
    assert found.loc["hazy-road", 2] == pytest.approx(spearmanr(first, second).statistic)
