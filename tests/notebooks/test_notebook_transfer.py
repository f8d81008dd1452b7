"""Reuse of what a search found, run on two embedded banks: recorded results."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pandas as pd
import pytest

from sfkit.reports import report

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "08_transfer_and_growth.ipynb"
SMALL = {
    "benchmark_pairs": 2,
    "report_on": [
        {"name": "bank-sharp:indoor-rooms", "pairs": 2},
        {"name": "bank-sharp:hazy-road", "pairs": 2},
    ],
    "population": 6,
    "generations": 2,
    "evaluations": 12,
}

# bad-3.0 in percent on the mean of the unseen benchmarks, recorded on a CPU.
TRANSFER = {
    ("sfkit-bank-sharp", "own search"): 13.9914,
    ("sfkit-bank-sharp", "found on sfkit-bank"): 17.1852,
    ("sfkit-bank", "own search"): 20.8056,
    ("sfkit-bank", "found on sfkit-bank-sharp"): 23.6591,
}
GROWTH = {
    "before, 10 sources": (14, 0, 4.8692),
    "11 sources, from chance": (12, 0, 4.6455),
    "11 sources, from the best of before": (16, 3, 4.0019),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("transfer")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "page.html")
    return place


def test_a_subset_serves_the_other_architecture_as_recorded(folder: Path) -> None:
    table = pd.read_csv(folder / "tables" / "transfer.csv", index_col=["pool", "subset from"])
    assert table["mean of the unseen"].to_dict() == pytest.approx(TRANSFER, abs=0.01)
    subsets = table["subset"].tolist()
    assert (subsets[0], subsets[1]) == (subsets[3], subsets[2])
    assert table.loc[("sfkit-bank-sharp", "found on sfkit-bank"), "reused"].startswith(
        "at +3.19 points against own search, no interval: indoor-rooms has 2 images"
    )
    assert table["evaluations"].tolist() == [24, 12, 28, 12]


def test_a_grown_pool_takes_over_what_was_scored(folder: Path) -> None:
    table = pd.read_csv(folder / "tables" / "growth.csv", index_col="search")
    assert list(table.index) == list(GROWTH)
    for name, (scored, known, validation) in GROWTH.items():
        assert (table.loc[name, "scored"], table.loc[name, "known"]) == (scored, known), name
        assert table.loc[name, "validation"] == pytest.approx(validation, abs=0.01), name


def test_both_figures_were_drawn_and_nothing_complained(folder: Path) -> None:
    cells = nbformat.read(folder / "page.ipynb", as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("application/vnd.plotly.v1+json" in output.get("data", {}) for output in outputs) == 2
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
