"""Runs that take hours: kept here, recorded in the repository, and never made or counted twice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest
from benchmark_scripts import imported


@pytest.fixture(scope="module")
def kept() -> Iterator[ModuleType]:
    with imported("kept") as (module,):
        yield module


def run(name: str, made: list[str]) -> Any:
    def job(_: Path) -> pd.DataFrame:
        made.append(name)
        part = {"pairs": [20]} if name.startswith("search") else {"batch": [4]}
        return pd.DataFrame({"search": [name], "needed": [float("inf")], "seconds": [1 / 3], **part})

    return job


@pytest.fixture
def made() -> list[str]:
    return []


@pytest.fixture
def runs(kept: ModuleType, tmp_path: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(kept, "RECORDED", tmp_path / "recorded")
    names = ("search-1", "search-2", "batch-1")
    return kept.KeptRuns(None, lambda: {name: run(name, made) for name in names}, tmp_path / "here" / "set")


def test_what_is_recorded_is_not_made_again_elsewhere(
    kept: ModuleType, runs: Any, made: list[str], tmp_path: Path
) -> None:
    assert runs.finished() == set()
    assert runs.results("").empty
    runs.main(["--most", "2"])
    runs.main(["--record"])
    assert {path.name for path in (tmp_path / "recorded").iterdir()} == {"set-search.csv"}

    there = kept.KeptRuns(None, runs.jobs, tmp_path / "there" / "set")
    assert there.finished() == {"search-1", "search-2"}
    there.main([])
    assert made == ["search-1", "search-2", "batch-1"]
    there.main(["--record"])
    recorded = kept.KeptRuns(None, runs.jobs, tmp_path / "nowhere" / "set")
    assert recorded.finished() == set(made)
    table = recorded.results("search")
    assert list(table["search"]) == ["search-1", "search-2"]
    assert list(table.columns) == ["search", "needed", "seconds", "pairs"]
    assert table["seconds"].tolist() == pytest.approx([1 / 3] * 2, rel=1e-5)
    assert (table["needed"] == float("inf")).all()


def test_a_run_made_again_counts_once(runs: Any) -> None:
    runs.main([])
    runs.main(["--record"])
    assert len(runs.results("search")) == 2
    runs.main(["--record"])
    assert len(runs.results("search")) == 2
