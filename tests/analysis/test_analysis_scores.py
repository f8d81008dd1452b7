"""The grid of scores, the cost of stages, labels: hand values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tiny import write_pool

from sfkit.analysis.costs import cost_table, stage_costs
from sfkit.analysis.labels import metric_label, score_text
from sfkit.analysis.scores import contenders, score_grid
from sfkit.analysis.tables import shown
from sfkit.errors import InputError
from sfkit.merging import open_pool
from sfkit.search.records import Counts


def scores() -> pd.DataFrame:
    rows = [
        ("base", "one", "epe", "px", 2.0, "validation"),
        ("merged", "one", "epe", "px", float("nan"), "validation"),
        ("base", "two", "bad-1.0", "%", 40.0, "reported"),
        ("merged", "two", "bad-1.0", "%", 30.0, "reported"),
    ]
    return pd.DataFrame(rows, columns=["network", "benchmark", "metric", "unit", "score", "role"])


def test_the_grid_keeps_order_units_and_failures() -> None:
    grid = score_grid(scores())
    assert grid.networks == ("base", "merged")
    assert grid.benchmarks == ("one", "two")
    assert grid.metrics == ("epe", "bad-1.0")
    assert [column.validation for column in grid.columns] == [True, False]
    assert [column.unit for column in grid.columns] == ["px", "%"]
    np.testing.assert_array_equal(grid.values, [[2.0, 40.0], [np.nan, 30.0]])


def test_a_network_scored_on_one_benchmark_only_is_missing_on_the_other() -> None:
    grid = score_grid(scores().drop(index=2))
    np.testing.assert_array_equal(grid.values[:, 1], [np.nan, 30.0])


def test_the_grid_refuses_a_network_twice_and_an_empty_table() -> None:
    with pytest.raises(InputError, match="found a network twice on one epe"):
        score_grid(pd.concat([scores(), scores().head(1)]))
    with pytest.raises(InputError, match="found no row"):
        score_grid(scores().head(0))


def test_contenders_are_base_sources_uniform_and_what_was_found(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path / "pool", sources=2))
    rows = contenders(pool, {"Stage 1": pool.equal("a", "b")})
    assert list(rows) == ["base", "a", "b", "uniform", "Stage 1"]
    assert rows["a"].weights[0] == (1.0,)
    assert rows["uniform"].weights[0] == (0.5, 0.5)
    assert rows["base"].sources == ()
    with pytest.raises(InputError, match="found 'uniform' twice"):
        contenders(pool, {"uniform": pool.uniform()})


def test_costs_put_every_candidate_in_one_place() -> None:
    one = Counts(candidates=40, distinct=11, cached=4, failed=2, seconds=3.5, seconds_saved=2.0)
    two = Counts(candidates=60, distinct=60, cached=0, failed=0, seconds=18.0)
    costs = stage_costs({"Stage 1": one, "Stage 2": two})
    assert (costs[0].computed, costs[0].cached, costs[0].repeated) == (7, 4, 29)
    assert [cost.candidates for cost in costs] == [40, 60]
    total = cost_table(costs).loc["total"]
    assert (total["candidates"], total["computed"], total["from the store"]) == (100, 67, 4)
    assert (total["wall seconds spent"], total["wall seconds saved"], total["failed"]) == (21.5, 2.0, 2)
    with pytest.raises(InputError, match="found no stage"):
        stage_costs({})


def test_cpu_seconds_stand_beside_wall_seconds_and_a_dash_where_nobody_measured_them() -> None:
    one = Counts(candidates=2, distinct=2, seconds=4.0, cpu_seconds=1.5, cpu_seconds_saved=0.0)
    two = Counts(candidates=3, distinct=3, seconds=5.0, cpu_seconds=2.0, cpu_seconds_saved=0.0)
    known = cost_table(stage_costs({"Stage 1": one, "Stage 2": two}))
    assert known["CPU seconds spent"].tolist() == [1.5, 2.0, 3.5]
    old = replace(two, cpu_seconds=None)  # of a journal, or from a store, of an earlier version
    table = cost_table(stage_costs({"Stage 1": one, "Stage 2": old}))
    assert table["CPU seconds spent"].isna().tolist() == [False, True, True], "the sum is not known either"
    assert shown(table).to_html().count("–") == 2


@pytest.mark.parametrize(
    ("metric", "label", "text"),
    [
        ("bad1", "bad-1.0 (% of pixels)", "bad-1.0 12.35 %"),
        ("epe", "EPE (px)", "EPE 12.35 px"),
        ("d1", "D1 (% of pixels)", "D1 12.35 %"),
        (None, "score", "score 12.35"),
    ],
)
def test_labels_carry_units(metric: str | None, label: str, text: str) -> None:
    assert metric_label(metric) == label
    assert score_text(metric, 12.3456) == text
