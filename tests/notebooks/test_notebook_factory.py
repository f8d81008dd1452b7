"""The factory notebook on two domains of the bank: what is made once, and what a newcomer costs."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pandas as pd
import pytest

from sfkit.reports import report

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "10_factory.ipynb"
SMALL = {
    "domains": ["haze", "far-scene"],
    "pairs": 2,
    "epochs": 1,
    "batch": 2,
    "crop": [64, 128],
    "validation_pairs": 1,
    "population": 2,
    "generations": 1,
    "evaluations": 5,
}
BASE = 3.4356  # bad-3.0 in percent of the bank's base on one pair, recorded on a CPU


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("factory")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "page.html")
    return place


def test_every_network_is_made_scored_and_priced(folder: Path) -> None:
    scores = pd.read_csv(folder / "tables" / "scores.csv", index_col=0)
    assert list(scores.index) == ["base", "uniform", "merged", "haze", "far-scene", "joint"]
    assert list(scores.columns) == ["courtyard", "grey-workshop", "hazy-road"]
    assert scores.loc["base", "courtyard"] == pytest.approx(BASE, abs=0.01)
    assert scores.loc["merged", "courtyard"] <= scores.loc["uniform", "courtyard"]
    costs = pd.read_csv(folder / "tables" / "costs.csv", index_col="part")
    assert costs["passes"].to_dict() == {"haze": 2, "far-scene": 2, "joint": 4, "search": 5}
    assert (costs["seconds"] > 0).all()


def test_a_newcomer_is_trained_alone_and_nothing_complained(folder: Path) -> None:
    cells = nbformat.read(folder / "page.ipynb", as_version=4).cells
    growth = next(cell for cell in cells if cell.id == "growth")
    assert growth.outputs[0].text.startswith("trained thin-things; ")
    assert [o.text for c in cells for o in c.get("outputs", []) if o.get("name") == "stderr"] == []
