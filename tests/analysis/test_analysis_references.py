"""The paper's rows beside one's own: only where benchmark and metric are the paper's."""

from __future__ import annotations

import pandas as pd
import pytest

from sfkit import InputError, figures
from sfkit.analysis import (
    ComparedColumn,
    reference_columns,
    reference_rows,
    score_grid,
    score_rows,
    with_references,
)
from sfkit.baselines import baseline_named, baselines, fusion_table
from sfkit.published import published

METRICS = {"kitti2012": "d1", "kitti2015": "d1", "middlebury": "bad-2.0", "eth3d": "bad-1.0"}


def columns(**metrics: str) -> tuple[ComparedColumn, ...]:
    return tuple(ComparedColumn(n, "openstereo", m, "%", validation=n == "eth3d") for n, m in metrics.items())


def test_all_four_have_the_papers_rows_with_their_means() -> None:
    found = reference_rows(columns(**METRICS))
    assert len(found) == len(published("tab:zero_shot"))
    assert found.loc["published RAFT-Stereo ‡"].to_dict() == {
        "kitti2012": 4.7,
        "kitti2015": 5.5,
        "middlebury": 12.6,
        "eth3d": 3.3,
        "mean": 6.52,
    }


def test_another_metric_or_another_benchmark_has_none() -> None:
    shown = columns(kitti2012="bad-3.0", middlebury="bad-2.0", own="epe")
    found = reference_rows(shown)
    assert list(found.columns) == ["middlebury"]
    assert reference_rows(columns(own="epe")).empty
    with pytest.raises(InputError, match="table of the paper"):
        reference_rows(shown, "tab:none")


def test_they_stand_below_ones_own_in_the_same_columns() -> None:
    shown = columns(eth3d="bad-1.0", own="bad-3.0")
    own = pd.DataFrame(
        [[1.5, 2.5, 2.0]], index=["mine"], columns=[shown[0].label, shown[1].label, "mean"]
    ).rename_axis("method")
    both = with_references(own, shown, "tab:merging_comparison")
    assert list(both.columns) == list(own.columns)
    assert both.loc["mine"].tolist() == [1.5, 2.5, 2.0]
    assert both.loc["NMRF Model Soups ‡", shown[0].label] == 2.22
    assert both.loc["NMRF Model Soups ‡"].isna().tolist() == [False, True, True]
    short = own.set_axis(["eth3d *", "own", "mean"], axis=1)
    assert with_references(short, shown).loc["published RAFT-Stereo ‡", "eth3d *"] == 3.3
    assert with_references(own, columns(own="bad-3.0")) is own


def test_they_are_drawn_where_the_paper_has_them() -> None:
    shown = columns(eth3d="bad-1.0", kitti2015="d1", own="bad-3.0")
    own = pd.DataFrame([[1.5, 2.5, 2.0]], index=["mine"], columns=[one.label for one in shown]).rename_axis(
        "method"
    )
    grid = score_grid(score_rows(with_references(own, shown), reference_columns(shown)))
    assert grid.benchmarks == ("eth3d", "kitti2015")
    assert grid.values[grid.networks.index("published RAFT-Stereo ‡")].tolist() == [3.3, 5.5]
    drawn = figures.scores_figure(grid, reference=None).data
    assert [len(trace.x) for trace in drawn] == [1 + len(published("tab:zero_shot"))] * 2


def test_every_method_says_its_strategy_and_the_papers_are_its_own() -> None:
    table = fusion_table()
    assert list(table.columns) == ["selection", "weights", "granularity"]
    assert "not stated" not in table.loc[[baseline_named(name).label for name in baselines()]].to_numpy()
    theirs = published("tab:fusion_compare")
    for ours, name in (("uniform", "Uniform Avg."), ("greedy soup (>=)", "Model Soups")):
        assert table.loc[ours, "selection"] == theirs.loc[name, "selection"].lower()
        assert table.loc[ours, "granularity"] == theirs.loc[name, "granularity"].lower()
    assert table.loc["uniform", "weights"] == "equal (1/N)"
    assert theirs.loc["Ours (Stage 1)", "weights"].lower() == table.loc["Stage 1", "weights"]
