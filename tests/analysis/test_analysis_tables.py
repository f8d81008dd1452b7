"""Marks of best and second best, LaTeX, Markdown, cost beside training: by hand and against pandas."""

from __future__ import annotations

import math
import re

import numpy as np
import pandas as pd
import pytest
from measured_records import measured

from sfkit import bank
from sfkit.analysis import (
    MethodCost,
    check_seconds,
    latex_table,
    overhead_table,
    ranks,
    shown,
    source_table,
)
from sfkit.errors import InputError
from sfkit.published import published, published_table


def table() -> pd.DataFrame:
    frame = pd.DataFrame(
        {"a_b": [1.0, np.nan], "c": [1.0, 5.0], "d": [3.0, 4.0], "note": ["10 %", "x"]}, index=["one", "two"]
    )
    frame.index.name = "bench"
    return frame


def test_ties_share_a_mark_and_missing_numbers_have_none() -> None:
    marks = ranks(table())
    assert marks.loc["one"].tolist() == ["best", "best", "second", ""]
    assert marks.loc["two"].tolist() == ["", "second", "best", ""]
    assert ranks(table(), along="column")["d"].tolist() == ["best", "second"][::1]
    assert ranks(table(), lower_is_better=False).loc["one"].tolist() == ["second", "second", "best", ""]
    assert ranks(table(), columns=["d"]).loc["two"].tolist() == ["", "", "best", ""]
    with pytest.raises(InputError, match="way to compare"):
        ranks(table(), along="rows")


def test_marks_are_those_the_paper_prints() -> None:
    for label in ("tab:individual_datasets", "tab:benchmark_results"):
        pd.testing.assert_frame_equal(
            ranks(published(label)), published_table(label).marks, check_dtype=False
        )


def test_the_big_table_has_a_row_a_benchmark_and_marks_what_guided() -> None:
    found = source_table([measured({"a": [10, 20], "b": [0, 50]}, validation=True)])
    assert list(found.index) == ["one (all-valid) bad-3.0 [%] *"]
    assert found.iloc[0].to_dict() == {"a": 15.0, "b": 25.0}
    assert source_table([measured({"a": [1]})], metric="epe").index[0] == "one (all-valid) epe [px]"
    with pytest.raises(InputError, match="found no benchmark"):
        source_table([])


def test_a_notebook_shows_decimals_and_a_dash() -> None:
    html = shown(table()).to_html()
    assert "1.00" in html
    assert "–" in html


def test_latex_is_what_pandas_writes_but_for_the_marks() -> None:
    ours = latex_table(table())
    bare = re.sub(r"\\(textbf|underline)\{([^}]*)\}", r"\2", ours)
    theirs = table().rename_axis(None).to_latex(float_format="%.2f", escape=True, na_rep="--")
    assert [re.sub(r"\s+", " ", line).strip() for line in bare.replace("bench & ", " & ").splitlines()] == [
        re.sub(r"\s+", " ", line).strip() for line in theirs.splitlines()
    ]
    assert r"\textbf{1.00} & \textbf{1.00} & \underline{3.00} & 10 \%" in ours
    floating = latex_table(table(), caption="50 % & more", label="tab:x")
    assert r"\caption{50 \% \& more}" in floating
    assert r"\label{tab:x}" in floating
    assert floating.startswith("\\begin{table}")


def test_a_method_is_set_beside_the_sources_trainings() -> None:
    both = MethodCost("both stages", 100, 800, 100.0)
    found = overhead_table([both], {"a": 1500.0, "b": 500.0})
    assert found.loc["both stages", "overhead [%]"] == pytest.approx(5.0)
    assert found.loc["fine-tuning the sources", "wall seconds"] == 2000.0
    assert pd.isna(found.loc["fine-tuning the sources", "evaluations"])
    with pytest.raises(InputError, match="expected positive seconds"):
        overhead_table([both], {})
    beside = overhead_table([both], {"a": 1500.0, "b": 500.0}, joint=4000.0)
    assert list(beside.index) == ["joint retraining", "fine-tuning the sources", both.method]
    assert beside.loc[both.method, "of joint retraining [%]"] == pytest.approx(both.seconds / 40.0)
    assert beside.loc[both.method, "overhead [%]"] == found.loc[both.method, "overhead [%]"]
    assert beside["of joint retraining [%]"].isna().tolist() == [True, True, False]
    with pytest.raises(InputError, match=r"found 0.0 seconds of joint retraining"):
        overhead_table([both], {"a": 1.0}, joint=0.0)
    check_seconds({}, None)
    with pytest.raises(InputError, match="seconds of joint retraining, none of any fine-tuning"):
        check_seconds({}, 9.0)


def test_cpu_seconds_stand_beside_the_trainings_and_are_divided_by_nothing() -> None:
    search = MethodCost("search", 100, 800, 100.0, cpu_seconds=30.0)
    old = MethodCost("from an old store", 100, 800, 100.0)
    training, cpu = {"a": 1500.0, "b": 500.0}, {"a": 600.0, "b": 400.0}
    table = overhead_table([search, old], training, 4000.0, training_cpu=cpu, joint_cpu=2000.0)
    assert table["CPU seconds"].tolist()[:3] == [2000.0, 1000.0, 30.0]
    assert math.isnan(table.loc["from an old store", "CPU seconds"])
    assert table.loc["search", "overhead [%]"] == pytest.approx(100 * 100.0 / 2000.0), "wall by wall"
    partly = overhead_table([search], training, training_cpu={"a": 600.0})
    assert math.isnan(partly.loc["fine-tuning the sources", "CPU seconds"])


def test_the_papers_overhead_follows_from_its_hours() -> None:
    hours = published("tab:computational_cost")["NMRF"]
    ours = MethodCost("total", 0, 0, 3600.0 * hours["Total (h)"])
    found = overhead_table([ours], {"joint": 3600.0 * hours["Joint retraining (h)"]})
    assert found.loc["total", "overhead [%]"] == pytest.approx(3.7, abs=0.05)


def test_the_bank_knows_what_its_sources_took() -> None:
    seconds = bank.training_seconds()
    assert len(seconds) == 11
    assert seconds["far-scene"] == 779.5, "of the wall, as those of searches are"
