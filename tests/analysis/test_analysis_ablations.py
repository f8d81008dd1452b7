"""Ablations on networks of one level: a merge has its sources' mean, so that answers are known by hand."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flat_world import benchmark, flat_spec

from sfkit import EvaluationStore, InputError, open_pool
from sfkit.analysis import (
    Experiment,
    fitness_criteria,
    fitness_metrics,
    growth,
    overlap,
    population_sizes,
    stage_variants,
    subset_transfer,
    validation_sets,
)
from sfkit.analysis.ablations import MEAN
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe

# Equal weights: {one, five} is 3, {one, ten} 5.5, {five, ten} 7.5, all three 5.33.
LEVELS = {"one": 1.0, "five": 5.0, "ten": 10.0}


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    return Experiment(
        pool=open_pool(flat_spec(tmp_path / "pool", LEVELS, base=4.5)),
        validation=benchmark("three", (3.125,), metric="epe"),
        reported=(benchmark("six", (5.75,), metric="epe"), benchmark("low", (2.5,), metric="epe")),
        store=EvaluationStore(":memory:"),
        population=8,
        generations=3,
        evaluations=20,
    )


def test_each_guide_finds_the_subset_whose_mean_is_nearest_to_its_truth(experiment: Experiment) -> None:
    table = validation_sets(experiment, routing=False)
    assert table["subset"].to_dict() == {"three": "one, five", "six": "one, ten", "low": "one, five"}
    assert table["overlap"].tolist() == pytest.approx([1.0, 1 / 3, 1.0])
    assert table[["three", "six", "low"]].to_numpy().tolist() == [
        [0.125, 2.75, 0.5],
        [2.375, 0.25, 3.0],
        [0.125, 2.75, 0.5],
    ]
    # Each row's mean leaves out its own guide.
    assert table[MEAN].tolist() == pytest.approx([(2.75 + 0.5) / 2, (2.375 + 3.0) / 2, (0.125 + 2.75) / 2])


def test_a_guide_cut_from_a_reported_benchmark_is_no_test_either(experiment: Experiment) -> None:
    longer = benchmark("six", (5.75, 6.0), metric="epe")
    table = validation_sets(experiment.changed(reported=(longer,)), routing=False)
    assert list(table.index) == ["three", "six"]
    assert table.loc["six", MEAN] == table.loc["six", "three"] == 2.375


def test_two_guides_of_one_name_are_refused(experiment: Experiment) -> None:
    with pytest.raises(InputError, match="expected a name for each"):
        validation_sets(experiment, [benchmark("three", (3.0,), metric="epe")])


def test_every_metric_guides_a_search_of_its_own(experiment: Experiment) -> None:
    table = fitness_metrics(experiment, ("epe", "bad-1.0"), routing=False)
    assert table["subset"].tolist() == ["one, five"] * 2  # it alone is within 1 px of the truth
    assert list(table.columns) == ["subset", "three *", "six", "low", "mean", MEAN, "overlap"]
    both = fitness_metrics(experiment, ("epe",))
    assert both.loc["epe", "three *"] < table.loc["epe", "three *"] == 0.125


def test_benchmark_and_metric_change_together(experiment: Experiment) -> None:
    six = replace(experiment.reported[0], metric="bad-0.3")
    table = fitness_criteria(experiment, [(experiment.validation, "epe"), (six, "bad-0.3")], routing=False)
    assert table["subset"].to_dict() == {"three epe": "one, five", "six bad-0.3": "one, ten"}
    assert table.loc["six bad-0.3", MEAN] == pytest.approx((2.375 + 3.0) / 2), "six guided, and is no test"
    assert table.loc["six bad-0.3", "mean"] == pytest.approx((2.375 + 0.25 + 3.0) / 3)
    assert list(fitness_criteria(experiment, routing=False).index) == ["three epe", "six epe", "low epe"]
    with pytest.raises(InputError, match="expected each once"):
        fitness_criteria(experiment, [(six, "epe"), (six, "EPE")])


def test_stage_2_closes_the_gap_that_equal_weights_leave(experiment: Experiment) -> None:
    table = stage_variants(experiment.changed(evaluations=60), seeds=(0, 1))
    first, second = table.loc["Stage 1", "three *"], table.loc["Stage 1+2", "three *"]
    assert first.tolist() == [0.125, 0.125]
    assert (second < 0.05).all()
    assert (table.loc["without scales", "three *"] < 0.05).all()
    assert list(table.index.unique("variant")) == [
        "Stage 1",
        "Stage 1+2",
        "without scales",
        "weights by block",
    ]


def test_a_subset_is_carried_to_a_pool_of_other_networks(experiment: Experiment, tmp_path: Path) -> None:
    """The second pool's networks are twice as far from the base: there another subset is the best."""
    doubled = {name: 4.5 + 2 * (level - 4.5) for name, level in LEVELS.items()}  # -2.5, 5.5, 15.5
    other = open_pool(replace(flat_spec(tmp_path / "other", doubled, base=4.5), name="doubled"))
    second = experiment.changed(pool=other, validation=benchmark("high", (6.75,), metric="epe"))
    table = subset_transfer(experiment, second)
    assert list(table.index) == [
        *(("flat", "own search"), ("flat", "found on doubled")),
        *(("doubled", "own search"), ("doubled", "found on flat")),
    ]
    assert table["subset"].tolist() == ["one, five", "one, ten", "one, ten", "one, five"]
    assert table["overlap"].tolist() == pytest.approx([1, 1 / 3, 1, 1 / 3])
    sentences = table["reused"].tolist()
    assert sentences[0] == sentences[2] == ""
    assert sentences[1].endswith("no interval: six has 1 image, an interval needs 5")
    evaluations = table["evaluations"].unstack()
    assert (evaluations["own search"] > 20).all()  # both stages; a reused subset needs Stage 2 alone
    assert evaluations.loc["flat", "found on doubled"] <= 20


def test_pools_of_one_name_are_no_transfer(experiment: Experiment) -> None:
    with pytest.raises(InputError, match="two pools called 'flat'"):
        subset_transfer(experiment, experiment.changed(seed=1))


def test_a_grown_pool_takes_over_what_was_scored(experiment: Experiment) -> None:
    """Without ``one`` there is one subset; with it four, one of them known."""
    before, chance, carried = growth(experiment, "one").to_dict("records")
    assert (before["scored"], before["known"], before["newcomer"]) == (1, 0, False)
    assert (before["validation"], chance["validation"]) == (4.375, 0.125)  # {five, ten} is 7.5, {one, five} 3
    assert (carried["scored"], carried["known"], carried["share known"]) == (4, 1, 0.25)
    assert 0 < carried["time saved"] < 1
    assert carried["newcomer"] is True


def test_the_newcomer_must_be_in_the_pool(experiment: Experiment) -> None:
    with pytest.raises(InputError, match=r"unknown source of the pool 'fvie'.*did you mean 'five'"):
        growth(experiment, "fvie")


def landscape(recipes: Sequence[Recipe]) -> list[Outcome]:
    """A sum over members: the best subset of six has the three with negative values."""
    worth = dict(zip("abcdef", (-3.0, 2.0, -1.0, 4.0, -0.5, 1.0), strict=True))
    return [Outcome(sum(worth[name] for name in recipe.sources)) for recipe in recipes]


def test_large_populations_find_what_an_exhaustive_search_finds() -> None:
    subsets = [s for size in range(2, 7) for s in itertools.combinations("abcdef", size)]
    optimum = min(landscape([Recipe.equal(s, ("all",)) for s in subsets]), key=lambda o: o.score).score
    record = population_sizes(
        list("abcdef"), ("all",), landscape, sizes=(2, 40), seeds=(0, 1, 2), generations=6, optimum=optimum
    )
    assert record.best.shape == record.distinct.shape == (2, 3)
    assert (record.best >= optimum).all()
    assert (record.best[1] == optimum).all()
    assert (record.distinct[0] < record.distinct[1]).all()
    assert (record.distinct <= len(subsets)).all()
    table = record.table()
    assert table.loc[40, "mean best"] == optimum == -4.5
    assert table.loc[2, "highest"] == np.max(record.best[0])


def test_population_sizes_need_sizes_and_seeds() -> None:
    with pytest.raises(InputError, match="found 0 sizes and 1 seeds"):
        population_sizes(["a", "b"], ("all",), landscape, sizes=(), seeds=(0,))


@pytest.mark.parametrize(
    ("one", "other", "share"), [("ab", "ab", 1.0), ("ab", "cd", 0.0), ("abc", "bcd", 0.5)]
)
def test_overlap_is_the_share_both_have(one: str, other: str, share: float) -> None:
    assert overlap(one, other) == overlap(other, one) == share
