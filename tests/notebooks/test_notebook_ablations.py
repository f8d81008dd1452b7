"""The ablations, run on the bank: recorded results, so that a changed number is noticed."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pandas as pd
import pytest

from sfkit.reports import report

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "07_ablations.ipynb"
PLOTLY = "application/vnd.plotly.v1+json"
SMALL = {
    "benchmark_pairs": 2,
    "report_on": [
        {"name": "bank-sharp:indoor-rooms", "pairs": 2},
        {"name": "bank-sharp:hazy-road", "pairs": 2},
    ],
    "population": 6,
    "generations": 2,
    "evaluations": 12,
    "seeds": 2,
}

# bad-3.0 in percent on the mean of the benchmarks that guided no search, recorded on a CPU.
GUIDES = {"courtyard": 13.9914, "indoor-rooms": 13.4512, "hazy-road": 4.7346}
METRICS = {"bad-3.0": 13.9914, "bad-1.0": 13.4841, "epe": 13.4841}
STAGES = {"Stage 1": 14.8603, "Stage 1+2": 13.9456, "without scales": 14.7925, "weights by block": 14.2639}
BEST = {2: 4.3379, 3: 4.8540, 4: 4.5719, 6: 4.6916}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("ablations")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "page.html")
    return place


def means(folder: Path, name: str, index: str) -> dict[object, float]:
    table = pd.read_csv(folder / "tables" / f"{name}.csv")
    return table.groupby(index, sort=False)["mean of the unseen"].mean().to_dict()


def test_what_guides_the_search_changes_its_answer(folder: Path) -> None:
    assert means(folder, "guides", "guided by") == pytest.approx(GUIDES, abs=0.01)
    assert means(folder, "metrics", "fitness metric") == pytest.approx(METRICS, abs=0.01)
    criteria = {f"{name} bad-3.0": mean for name, mean in GUIDES.items()}
    assert means(folder, "criteria", "fitness") == pytest.approx(criteria, abs=0.01)


def test_what_each_part_adds(folder: Path) -> None:
    assert means(folder, "stages", "variant") == pytest.approx(STAGES, abs=0.01)


def test_populations_and_their_best(folder: Path) -> None:
    table = pd.read_csv(folder / "tables" / "population.csv", index_col="population")
    assert table["mean best"].to_dict() == pytest.approx(BEST, abs=0.01)
    assert (table["subsets scored"] > 0).all()


def test_every_figure_was_drawn_and_nothing_complained(folder: Path) -> None:
    cells = nbformat.read(folder / "page.ipynb", as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum(PLOTLY in output.get("data", {}) for output in outputs) == 4
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
