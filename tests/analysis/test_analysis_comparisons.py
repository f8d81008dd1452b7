"""The comparison table: hand values, marks, gaps, verdicts, seeds in one row."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from measured_records import measured
from tiny import write_pairs, write_pool

from sfkit.analysis import Measured, compare_networks, measure_recipes, paired_difference
from sfkit.datasets import open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, score_recipes
from sfkit.merging import open_pool


def three() -> list[Measured]:
    guide = {"base": [50, 60] * 10, "fit": [30, 40] * 10, "s0": [40, 50] * 10, "s1": [44, 54] * 10}
    first = {"base": [20] * 20, "fit": [25] * 20, "s0": [10] * 20, "s1": [12] * 20}
    second = {"base": [30, 40] * 10, "fit": [32, 42] * 10, "s0": [30, 40] * 10, "s1": [30, 40] * 10}
    return [
        measured(guide, name="guide", validation=True),
        measured(first, name="first"),
        measured(second, name="second"),
    ]


def test_scores_means_gap_and_difference_are_those_of_hand() -> None:
    found = compare_networks(three(), "base", seeds={"ours": ["s0", "s1"]})
    assert [row.network for row in found.rows] == ["base", "fit", "ours"]
    ours = found.row("ours")
    assert ours.scores == pytest.approx((47.0, 11.0, 35.0))
    assert (ours.guided, ours.unseen, ours.gap) == pytest.approx((47.0, 23.0, -24.0))
    assert ours.unseen_difference is not None
    assert ours.unseen_difference.value == pytest.approx(23.0 - 27.5)
    # All images agree; the two seeds score 22.5 and 23.5, and t with one degree of freedom is 12.706.
    assert ours.unseen_difference.interval == pytest.approx((-4.5 - 6.353, -4.5 + 6.353), abs=1e-3)
    assert [difference.value for difference in ours.differences] == pytest.approx([-8.0, -9.0, 0.0])
    assert ours.spread is not None
    assert ours.spread.values == pytest.approx((22.5, 23.5))


def test_the_table_marks_validation_and_gives_a_verdict_a_row() -> None:
    table = compare_networks(three(), "base").table()
    assert list(table.columns[:3]) == [
        "guide (all-valid) bad-3.0 [%] *",
        "first (all-valid) bad-3.0 [%]",
        "second (all-valid) bad-3.0 [%]",
    ]
    assert table.loc["base", "verdict"] == "the reference"
    assert math.isnan(table.loc["base", "difference to base [%]"])
    assert table.loc["fit", "verdict"] == "worse than base: +3.50 [+3.50, +3.50] points"
    assert table.loc["fit", ["low", "high"]].to_list() == pytest.approx([3.5, 3.5])
    assert table["seeds ±"].isna().all()


def test_a_network_that_fits_the_validation_images_is_called_out() -> None:
    found = compare_networks(three(), "base")
    assert [row.network for row in found.rows if row.overfit] == ["fit"]
    assert (
        "fit gained on what guided it (better than base: -20.00 [-20.00, -20.00] points) and not on unseen "
        "benchmarks (worse than base: +3.50 [+3.50, +3.50] points): it fits the validation images."
    ) in found.sentences


def test_without_unseen_benchmarks_the_sentence_says_that_it_is_no_test() -> None:
    found = compare_networks(three()[:1], "base")
    row = found.row("fit")
    assert row.unseen_difference is None
    assert math.isnan(row.unseen)
    assert not row.overfit
    assert row.sentences[0].endswith("points (on what guided the search, no test).")


def test_under_five_images_a_row_has_a_difference_and_no_verdict() -> None:
    few = [measured({"base": [20, 30], "a": [10, 25], "b": [30, 20]})]
    sentences = compare_networks(few, "base").sentences
    assert sentences[0] == (
        "a is at -7.50 points against base, no interval: one has 2 images, an interval needs 5."
    )
    assert len(sentences) == 2


def test_what_is_called_better_is_corrected_for_the_number_of_rows() -> None:
    # Of ten networks that differ from the base by chance alone, one looks better by its own interval.
    rng = np.random.default_rng(3)
    hard = rng.integers(300, 600, 8)
    rows = {f"n{n}": [int(x) for x in hard + rng.integers(-9, 10, 8)] for n in range(10)}
    one = measured({"base": [int(x) for x in hard], **rows}, pixels=[1000] * 8)
    found = [row.difference for row in compare_networks([one], "base").rows[1:]]
    alone = [d for d in found if d is not None and d.interval and not d.interval[0] <= 0 <= d.interval[1]]
    assert alone
    assert all(d is not None and d.within_noise for d in found)
    assert str(alone[0]).endswith("points (one of 10 comparisons)")
    assert alone[0].allowance == "one of 10 comparisons"


def test_the_reference_itself_can_be_called_out() -> None:
    found = compare_networks(three(), "fit")
    assert found.row("base").outdoes_on_unseen
    assert any(
        s.startswith("fit gained on what guided it against base (-20.00 points)") for s in found.sentences
    )


def test_rows_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="found no row 'bass'"):
        compare_networks(three(), "bass")
    with pytest.raises(InputError, match="stands in two rows"):
        compare_networks(three(), "base", seeds={"fit": ["s0", "s1"]})
    with pytest.raises(InputError, match=r"found the runs \['s9'\]"):
        compare_networks(three(), "base", seeds={"ours": ["s0", "s9"]})
    with pytest.raises(InputError, match="found no row 'ours'"):
        compare_networks(three(), "base").row("ours")


def test_measured_recipes_score_what_the_table_of_scores_says(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path / "pool", sources=2))
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform()}
    benchmarks = [
        open_benchmark("pairs", write_pairs(tmp_path / name, count), metric="bad-1.0")
        for name, count in (("guide", 1), ("test", 3))
    ]
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        found = measure_recipes(
            pool, recipes, benchmarks, also=["bad-0.25"], validation=["guide"], store=store
        )
        table = score_recipes(pool, recipes, benchmarks, metrics=["bad-1.0", "bad-0.25"], store=store)
        assert table["cached"].all()
    assert [one.validation for one in found] == [True, False]
    assert [len(one.ids) for one in found] == [1, 3]
    for _, row in table.iterrows():
        one = next(one for one in found if one.benchmark == row["benchmark"])
        assert one.score(row["network"], metric=row["metric"]) == row["score"]


def test_tables_of_methods_that_differ_by_chance_alone_claim_nothing_in_19_of_20() -> None:
    """Eight images on each of two tests; base, four networks, and three methods of five seeds each."""
    rng = np.random.default_rng(12)
    seeds = {f"method {m}": [f"method {m}, seed {s}" for s in range(5)] for m in range(3)}
    runs = [run for found in seeds.values() for run in found]
    claimed = blind = 0
    for _ in range(60):
        level = dict(zip(runs, rng.normal(0.0, 4.0, len(runs)), strict=True))
        tests = []
        for name in ("near", "far"):
            hard = rng.normal(40.0, 8.0, 8)
            bad = {
                network: np.clip(np.rint(hard + level.get(network, 0.0) + rng.normal(0.0, 3.0, 8)), 0, 100)
                for network in ("base", "a", "b", "c", "d", *runs)
            }
            counts = {network: [int(value) for value in row] for network, row in bad.items()}
            tests.append(measured(counts, name=name))
        rows = compare_networks(tests, "method 2", seeds=seeds).rows
        claimed += any(row.difference is not None and row.difference.within_noise is False for row in rows)
        alone = paired_difference(tests, "method 0, seed 0", "method 2, seed 0")
        blind += alone.within_noise is False
    assert claimed / 60 <= 0.05 + 0.05, "0.05: of a Monte Carlo of 60"
    assert blind / 60 > 0.3, "images alone, and one seed, would claim much"
