"""The paper's figures: what they draw are the records' numbers, whatever is known by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flat_world import benchmark, flat_pool

from sfkit import InputError, Recipe
from sfkit.analysis import (
    InterpolationCurve,
    MethodCost,
    measure_recipes,
    overhead,
    qualitative_grid,
    retraining_against_merging,
    selection_statistics,
)
from sfkit.figures import (
    interpolation_figure,
    method_cost_figure,
    overhead_figure,
    qualitative_figure,
    rivals_figure,
    teaser_figure,
)
from sfkit.published import published

BLOCKS = ("level", "offset")


def test_each_source_stands_beside_its_strongest_competitor() -> None:
    found = {
        "one": Recipe.equal(["a", "b"], BLOCKS),
        "two": Recipe.equal(["b", "c"], BLOCKS),
        "three": Recipe.weighted({"a": 0.9, "b": 0.1}, BLOCKS),
    }
    statistics = selection_statistics(found, ["a", "b", "c"])
    table = statistics.rivals()
    assert table["chosen (%)"].tolist() == pytest.approx([200 / 3, 100.0, 100 / 3])
    assert table["mean weight (%)"].tolist() == pytest.approx([140 / 3, 110 / 3, 50 / 3])
    assert table["strongest other"].tolist() == ["b", "a", "b"]
    assert table.loc["a", "its chosen (%)"] == 100.0
    assert table.loc["b", "its mean weight (%)"] == pytest.approx(140 / 3)
    figure = rivals_figure(statistics)
    own = next(trace for trace in figure.data if trace.name == "the source")
    assert list(own.x) == table["chosen (%)"].tolist()
    assert "chosen by all: b" in figure.layout.title.subtitle.text
    alone = selection_statistics({"one": Recipe.equal(["a"], BLOCKS)}, ["a"]).rivals()
    assert alone.loc["a", "strongest other"] == ""
    assert np.isnan(alone.loc["a", "its chosen (%)"])


def test_pictures_have_a_row_a_benchmark_and_a_column_a_network(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path, {"low": 4.0, "high": 12.0})
    worlds = [benchmark("near", (5.0, 8.0)), benchmark("far", (9.0,), metric="epe")]
    networks = {"uniform": pool.uniform(), "merged": pool.equal("high")}
    rows = qualitative_grid([(pool, networks)], worlds, pairs={"near": "pair1"})
    assert [(row.benchmark, row.pair) for row in rows] == [("near", "pair1"), ("far", "pair0")]
    assert rows[0].networks[0].scores == {"bad-1.0": 0.0}, "the mean of 4 and 12 is 8 px"
    assert rows[1].networks[1].scores == {"epe": 3.0}
    figure = qualitative_figure(rows)
    names = [image.name for image in figure.layout.images]
    assert names == ["image", "uniform", "merged"] * 2
    titles = [note.text for note in figure.layout.annotations]
    assert "merged: EPE 3.00 px" in titles
    assert [axis.title.text for axis in figure.select_yaxes(col=1)] == ["near", "far"]


def test_two_pools_stand_side_by_side(tmp_path: Path) -> None:
    first, second = (flat_pool(tmp_path / name, {"low": 4.0}) for name in ("a", "b"))
    world = [benchmark("near", (5.0,))]
    with pytest.raises(InputError, match="expected a name for each"):
        qualitative_grid([(first, {"x": first.uniform()}), (second, {"x": second.uniform()})], world)
    found = qualitative_grid([(first, {"x": first.uniform()}), (second, {"y": second.uniform()})], world)
    assert [one.name for one in found[0].networks] == ["flat: x", "flat: y"]
    with pytest.raises(InputError, match="found 0 pools"):
        qualitative_grid([], world)
    with pytest.raises(InputError, match="found rows of 0 sets"):
        qualitative_figure([])


def test_a_joint_network_stands_beside_merges(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path, {"low": 4.0, "joint": 6.0})
    recipes = {"joint": pool.equal("joint"), "merged": pool.equal("low", "joint"), "uniform": pool.uniform()}
    measured = measure_recipes(
        pool, recipes, [benchmark("a", (5.0,), metric="epe"), benchmark("b", (7.5,), metric="epe")]
    )
    record = retraining_against_merging(measured, "joint", {"joint": 7200.0, "merged": 360.0})
    assert [(way.name, way.joint) for way in record.ways] == [("joint", True), ("merged", False)]
    assert [way.score for way in record.ways] == pytest.approx([1.25, 1.25])
    table = record.table()
    assert table.loc["merged", "of joint retraining (%)"] == pytest.approx(5.0)
    figure = teaser_figure(record)
    assert [list(trace.x) for trace in figure.data] == [[120.0], [6.0]]
    assert "in 5.0 % of its wall time" in figure.layout.title.subtitle.text
    with pytest.raises(InputError, match="no positive seconds of 'joint'"):
        retraining_against_merging(measured, "joint", {"merged": 1.0})
    with pytest.raises(InputError, match="measured network"):
        retraining_against_merging(measured, "retrained", {"retrained": 1.0})


def test_methods_are_bars_of_what_they_take() -> None:
    costs = [MethodCost("a", 10, 80, 2.5), MethodCost("b", 1200, 9600, 60.0, cpu_seconds=20.0)]
    figure = method_cost_figure(costs)
    assert [list(trace.x) for trace in figure.data] == [[10, 1200], [2.5, 60.0], [None, 20.0]]
    assert [trace.name for trace in figure.data[1:]] == ["wall time", "CPU time"]
    assert "most: b, 1,200 evaluations" in figure.layout.title.subtitle.text
    trainings = method_cost_figure([MethodCost("a", 0, 80, 2.5), MethodCost("b", 0, 9600, 60.0)], passes=True)
    assert list(trainings.data[0].x) == [80, 9600]
    assert "most: b, 9,600 passes" in trainings.layout.title.subtitle.text


def test_the_papers_overhead_is_a_bar() -> None:
    """Of table `tab:computational_cost`: NMRF's search took 3.7 % of the hours of joint retraining."""
    hours = published("tab:computational_cost")["NMRF"]
    ours = MethodCost("search", 0, 0, 3600.0 * hours["Total (h)"])
    record = overhead([ours], {"one": 7200.0, "other": 7200.0}, 3600.0 * hours["Joint retraining (h)"])
    figure = overhead_figure(record)
    names = [trace.name for trace in figure.data]
    assert names[0].startswith("of joint retraining (")
    assert names[1] == "of fine-tuning the sources (14,400 s, an unknown time of CPU)"
    joint, tuning = (trace.x[0] for trace in figure.data)
    assert joint == pytest.approx(3.7, abs=0.05)
    assert tuning == pytest.approx(100 * hours["Total (h)"] / 4)
    said = figure.layout.title.subtitle.text
    assert said.startswith(f"most: search, {tuning:.1f} % of fine-tuning the sources; a lower bound")
    assert len(overhead_figure(overhead([ours], {"one": 7200.0})).data) == 1


def test_many_lines_have_a_panel_each_on_one_scale() -> None:
    at = np.array([0.0, 0.5, 1.0])
    curves = [
        InterpolationCurve(
            name=f"source {n}",
            benchmark="near",
            metric="epe",
            unit="px",
            validation=True,
            positions=at,
            scores=np.array([5.0, n, 6.0]),
        )
        for n in range(7)
    ]
    figure = interpolation_figure(curves)
    assert [note.text for note in figure.layout.annotations] == [f"source {n}" for n in range(7)]
    drawn = [trace for trace in figure.data if trace.mode == "lines+markers"]
    assert [list(trace.y) for trace in drawn] == [[5.0, n, 6.0] for n in range(7)]
    assert len({trace.xaxis for trace in drawn}) == 7
    assert {axis.matches for axis in figure.select_yaxes()} <= {None, "y", "y5"}
    assert figure.layout.title.subtitle.text.startswith("near *: 5 of 7 lines are best between")
