"""Tables of scores: one row a network, benchmark and metric; and the wide table people read."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
import pytest
from flat_world import benchmark, calls, flat_pool, sample

from sfkit.datasets.benchmark import memory_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, pivot, score_recipes
from sfkit.evaluation.table import COLUMNS, write_table
from sfkit.merging import Pool, Recipe


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"))


@pytest.fixture
def recipes(pool: Pool) -> dict[str, Recipe]:
    names = ("low", "high", "below", "wild")
    return {"base": pool.base_recipe(), **{name: pool.equal(name) for name in names}}


@pytest.fixture
def scores(pool: Pool, recipes: dict[str, Recipe]) -> pd.DataFrame:
    three = [benchmark("guide", (5.0,)), benchmark("near", (4.0,)), benchmark("far", (8.0,))]
    return score_recipes(pool, recipes, three, metrics=("bad-2.0", "epe"), validation=("guide",))


def test_one_row_a_network_benchmark_and_metric(scores: pd.DataFrame) -> None:
    assert tuple(scores.columns) == COLUMNS
    assert len(scores) == 5 * 3 * 2
    row = scores.set_index(["network", "benchmark", "metric"]).loc[("high", "near", "epe")]
    assert row.to_dict() == {
        "protocol": "all-valid", "unit": "px", "score": 8.0, "role": "reported", "images": 1, "flagged": 0,
        "failure": None, "cached": False,
    }  # fmt: skip
    assert set(scores.query("benchmark == 'guide'")["role"]) == {"validation"}


def test_broken_and_failed_networks_are_told_apart(scores: pd.DataFrame) -> None:
    rows = scores.set_index(["network", "benchmark", "metric"]).sort_index()
    assert rows.loc[("below", "far", "bad-2.0"), "score"] == 100.0
    assert rows.loc[("below", "far", "epe"), "score"] == math.inf
    assert rows.loc[("below", "far", "epe"), "flagged"] == 1
    assert math.isnan(rows.loc[("wild", "far", "epe"), "score"])
    assert rows.loc[("wild", "far", "epe"), "failure"] == "RuntimeError: level 90 is too high"


def test_the_wide_table(scores: pd.DataFrame) -> None:
    table = pivot(scores)
    assert list(table.columns) == [
        "guide (all-valid) bad-2.0 [%] *",
        "guide (all-valid) epe [px] *",
        "near (all-valid) bad-2.0 [%]",
        "near (all-valid) epe [px]",
        "far (all-valid) bad-2.0 [%]",
        "far (all-valid) epe [px]",
        "mean of all bad-2.0 [%]",
        "mean of unseen bad-2.0 [%]",
        "mean of all epe [px]",
        "mean of unseen epe [px]",
    ]
    assert list(table.index) == ["base", "low", "high", "below", "wild"]
    benchmarks, means = [0, 0, 0, 1, 100, 3], [100 / 3, 50, 4 / 3, 2]
    assert table.loc["base"].tolist() == pytest.approx([*benchmarks, *means]), "last, what guided no search"
    assert table.loc["wild"].isna().all(), "a network that failed has no mean"
    assert list(pivot(scores, mean=False).columns) == list(table.columns)[:6]


def test_what_nothing_guided_has_one_mean(scores: pd.DataFrame) -> None:
    """Were it said to be of the unseen, a reader would look for the benchmark that was seen."""
    table = pivot(scores[scores["role"] == "reported"])
    assert list(table.columns)[-2:] == ["mean bad-2.0 [%]", "mean epe [px]"]
    assert table.loc["base"].tolist() == [0, 1, 100, 3, 50, 2]


def test_a_guide_under_another_metric_is_in_no_mean(scores: pd.DataFrame) -> None:
    guide = scores["benchmark"] == "guide"
    table = pivot(scores[guide & (scores["metric"] == "bad-2.0") | ~guide & (scores["metric"] == "epe")])
    assert list(table.columns)[-1] == "mean of unseen epe [px]"
    assert not [column for column in table.columns if column.startswith("mean of all")]


def test_a_network_without_a_score_on_one_benchmark_has_no_mean(scores: pd.DataFrame) -> None:
    """Its mean over the others would flatter it."""
    scores.loc[(scores["network"] == "low") & (scores["benchmark"] == "far"), "score"] = math.nan
    table = pivot(scores)
    assert table.loc["low", "near (all-valid) epe [px]"] == 0
    assert math.isnan(table.loc["low", "mean of unseen epe [px]"])
    assert table.loc["base", "mean of unseen epe [px]"] == 2


def test_one_set_of_pairs_under_two_protocols_makes_two_columns(pool: Pool) -> None:
    pairs = [sample("a", 5.0)]
    both = [memory_benchmark("same", pairs, family="eth3d", protocol=p) for p in ("raft", "all-valid")]
    table = pivot(score_recipes(pool, {"base": pool.base_recipe()}, both), mean=False)
    assert list(table.columns) == ["same (raft) epe [px]", "same (all-valid) epe [px]"]


def test_every_benchmark_is_checked_before_the_first_evaluation(
    pool: Pool, recipes: dict[str, Recipe]
) -> None:
    calls.clear()
    bad = memory_benchmark("bad", [sample("b", math.inf)])
    with pytest.raises(InputError, match="no valid pixel"):
        score_recipes(pool, recipes, [benchmark(), bad])
    with pytest.raises(InputError, match="unknown metric"):
        score_recipes(pool, recipes, [benchmark()], metrics=("epe", "bda"))
    with pytest.raises(InputError, match="unknown source"):
        score_recipes(pool, {**recipes, "x": Recipe.equal(("nobody",), pool.blocks)}, [benchmark()])
    assert calls == []


def test_scores_come_from_the_store_and_progress_is_told(
    pool: Pool, recipes: dict[str, Recipe], tmp_path: Path
) -> None:
    heard: list[tuple[str, int, int]] = []
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        first = score_recipes(pool, recipes, [benchmark()], store=store, progress=lambda *a: heard.append(a))
        again = score_recipes(pool, recipes, [benchmark()], store=store)
    assert heard == [("noise", done, 5) for done in range(6)]
    assert not first["cached"].any()
    assert again["cached"].all()
    pd.testing.assert_frame_equal(first.drop(columns="cached"), again.drop(columns="cached"))


def test_tables_are_written_as_they_are(scores: pd.DataFrame, tmp_path: Path) -> None:
    long = pd.read_csv(write_table(scores, tmp_path / "new" / "long.csv"))
    assert tuple(long.columns) == COLUMNS
    wide = pd.read_csv(write_table(pivot(scores), tmp_path / "wide.csv"), index_col="network")
    assert wide.loc["base"].tolist() == pivot(scores).loc["base"].tolist()
