"""RunTable without a browser: the numbers of the page, read again on command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from browser_search import searches_by_model, subset_search
from sfkit_widgets import RunTable

from sfkit.analysis.run_overview import COLUMNS, overviews, parallel_axes, run_cells
from sfkit.errors import InputError
from sfkit.search.runs import find_runs


def test_the_table_has_the_page_s_numbers_and_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    searches_by_model(tmp_path / "first" / "journal.jsonl")
    table = RunTable(tmp_path)
    assert [row["stage"] for row in table.rows] == ["Stage 1", "Stage 2"]
    assert table.columns == list(COLUMNS)
    (run,), metrics = overviews(find_runs(tmp_path))
    assert metrics == {str(run.folder): ""}
    for row, stage in zip(table.rows, run.stages, strict=True):
        texts = [text for text, _ in run_cells("first", "", stage)]
        assert [text for text, _ in row["cells"]] == texts
        best = [score if math.isfinite(score) else None for score in stage.best_so_far]
        assert row["best"] == [None if b is None else pytest.approx(b, rel=1e-5) for b in best]
    which, how = table.rows
    assert how["axes"]["leading"] == 1
    axes = parallel_axes(run.stages[1].routes)
    assert how["axes"]["lines"][-1] == pytest.approx(axes.values[axes.lines[-1]], rel=1e-5)
    assert how["axes"]["lines"][-1][-1] == min(line[-1] for line in how["axes"]["lines"])
    assert [rise for _, rise in which["importance"]] == sorted(
        (rise for _, rise in which["importance"]), reverse=True
    )
    assert dict(which["importance"]) == pytest.approx(dict(run.stages[0].importance), rel=1e-5)
    (tmp_path / "second").mkdir()
    subset_search(10, tmp_path / "second" / "journal.jsonl")[0].run()
    message = {"command": "read", "arguments": {}, "view": "v", "sequence": 1}
    table._receive(table, message, [])
    assert [row["cells"][0][0] for row in table.rows] == ["second", "first", "first"]
    json.dumps(table.rows, allow_nan=False)
    assert ">second<" in table.sheet().svg()


def test_what_is_no_folder_is_refused_and_an_empty_one_is_not(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        RunTable(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"unknown argument of RunTable 'thme'.*did you mean 'theme'"):
        RunTable(tmp_path, thme="dark")
    assert "No search has left a journal here." in RunTable(tmp_path).sheet().svg()
