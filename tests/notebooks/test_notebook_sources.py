"""The notebook that asks what each source knows, run on the bank: recorded results."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pandas as pd
import pytest
from nbformat import NotebookNode

from sfkit.reports import report

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "06_what_each_source_knows.ipynb"
PLOTLY = "application/vnd.plotly.v1+json"
SMALL = {
    "pool": "bank",
    "benchmark_pairs": 2,
    "report_on": ["bank:indoor-rooms"],
    "report_pairs": 5,
    "source_pairs": 1,
    "population": 6,
    "generations": 2,
    "seeds": 2,
}

# bad-3.0 in percent on two pairs of the bank's courtyard and five of its indoor rooms, recorded on a CPU.
GUIDED = {"base": 39.4884, "haze": 20.8706, "uneven-exposure": 24.1136, "uniform": 40.0445}
UNSEEN = {"base": 30.7864, "haze": 24.2508, "scanned-street": 28.0347, "uniform": 25.1313}
# Differences to the equal mixture of all sources on the unseen pairs: value, ends of the interval.
NOISE = {"base": (5.6551, 1.0803, 10.2300), "sensor-noise": (-2.2040, -23.3542, 18.9461)}
SPREAD = "30.46 ± 1.23 over 2 seeds (29.59 to 31.32)"
# What it does to the best subset's score when one block follows one source.
PROBES = {"backbone": -3.5984, "neck": 0.2496, "cost_volume": -8.0248, "head": 0.4876}
GUESSED = {"Stage 1": 24.5082, "feature to courtyard": 26.0173, "rgb to indoor-rooms": 25.6291}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("sources")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "report.html")
    return place


@pytest.fixture(scope="module")
def executed(folder: Path) -> NotebookNode:
    return nbformat.read(folder / "report.ipynb", as_version=4)


def printed(executed: NotebookNode, name: str) -> str:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.get("name") == name)


def test_the_big_table_holds_the_recorded_scores(folder: Path) -> None:
    table = pd.read_csv(folder / "sources.csv", index_col="benchmark")
    assert list(table.index) == [
        "courtyard (all-valid) bad-3.0 [%] *",
        "indoor-rooms (all-valid) bad-3.0 [%]",
    ]
    assert table.shape == (2, 13)
    for row, recorded in enumerate((GUIDED, UNSEEN)):
        assert table.iloc[row][list(recorded)].to_dict() == pytest.approx(recorded, abs=0.02)
    latex = (folder / "sources.tex").read_text()
    assert r"haze & \textbf{20.87} & \underline{24.25}" in latex
    assert r"uneven-exposure & \underline{24.11}" in latex


def test_differences_have_the_recorded_intervals(folder: Path, executed: NotebookNode) -> None:
    table = pd.read_csv(folder / "comparison.csv", index_col="network")
    columns = ["difference to uniform [%]", "low", "high"]
    for network, recorded in NOISE.items():
        assert table.loc[network, columns].tolist() == pytest.approx(recorded, abs=0.03), network
    said = printed(executed, "stdout")
    assert "sensor-noise is within noise of uniform: -2.20 [-23.35, +18.95] points." in said
    assert "base is within noise of uniform: +5.66 [+1.08, +10.23] points (one of 12 comparisons)." in said
    assert "it fits the validation images" not in said  # two pairs tell no gain


def test_seeds_and_probes_are_those_recorded(folder: Path, executed: NotebookNode) -> None:
    assert SPREAD in printed(executed, "stdout")
    probes = pd.read_csv(folder / "probes.csv", index_col="block")
    assert probes["haze"].to_dict() == pytest.approx(PROBES, abs=0.02)


def test_guesses_from_the_data_scored_as_recorded(folder: Path) -> None:
    table = pd.read_csv(folder / "similarity.csv", index_col="network")
    assert len(table) == 1 + 3 * 2
    assert table["mean of unseen [%]"][list(GUESSED)].to_dict() == pytest.approx(GUESSED, abs=0.02)


def test_every_figure_was_drawn_and_nothing_complained(executed: NotebookNode) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert sum(PLOTLY in output.get("data", {}) for output in outputs) == 7
    assert printed(executed, "stderr") == ""
