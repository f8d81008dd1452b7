"""The notebook that edits a routing by hand, run on the bank: recorded results, the widget's last state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import nbformat
import pandas as pd
import pytest
from nbformat import NotebookNode
from report_page import opened

import sfkit
from sfkit.editing import seen_by_hand
from sfkit.reports import report

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "03_routing_inspector.ipynb"
SMALL = {"pool": "bank", "benchmark_pairs": 2, "evaluations": 12}
STATE = "application/vnd.jupyter.widget-state+json"

# bad-3.0 in percent on the bank's courtyard, recorded on a CPU: the change on its first pair when a source
# leaves the mixture, and the score of two pairs before, edited by hand, and after Stage 2 went on from there.
WITHOUT = {"far-scene": -1.4201, "haze": -0.0718, "uneven-exposure": 0.7215, "open-ground": 3.3109}
PINNED, EDITED, REFINED = 24.8657, 27.4617, 22.4854


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("inspector")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "report.html")
    return place


@pytest.fixture(scope="module")
def executed(folder: Path) -> NotebookNode:
    return nbformat.read(folder / "report.ipynb", as_version=4)


def test_what_every_source_is_good_for(folder: Path) -> None:
    table = pd.read_csv(folder / "without.csv", index_col="source").iloc[:, 0]
    assert list(table.index) == list(WITHOUT)
    assert table.to_dict() == pytest.approx(WITHOUT, abs=0.02)


def test_the_edit_and_what_stage_2_made_of_it(executed: NotebookNode, folder: Path) -> None:
    printed = "".join(
        output.text
        for cell in executed.cells
        for output in cell.get("outputs", [])
        if output.get("name") == "stdout"
    )
    assert f"edited {EDITED:.2f}, A {PINNED:.2f}" in printed
    assert f"bad-3.0 {REFINED:.2f}" in printed
    assert sfkit.read_recipe(folder / "edited.safetensors").sources


def test_what_was_scored_by_hand_is_known_to_reports(folder: Path) -> None:
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        (seen,) = seen_by_hand(store, [sfkit.open_benchmark("bank:courtyard", pairs=1)])
        assert (seen.edits, seen.pairs) == (1, ("courtyard-00",))
        assert seen_by_hand(store, [sfkit.open_benchmark("bank:hazy-road", pairs=1)]) == ()


def test_the_saved_widget_shows_the_last_state(executed: NotebookNode, folder: Path) -> None:
    entries = executed.metadata["widgets"][STATE]["state"].values()
    (shown,) = [entry for entry in entries if "recipe_json" in entry["state"]]
    saved = sfkit.Recipe.from_json(shown["state"]["recipe_json"])
    assert set(saved.sources) == set(WITHOUT)
    written = sfkit.read_recipe(folder / "edited.safetensors")
    assert written == saved
    pictures = {tuple(buffer["path"]) for buffer in shown["buffers"]}
    assert {("left_picture",), ("truth_picture",), ("disparity_picture",), ("error_picture",)} <= pictures


def test_nothing_complained(executed: NotebookNode) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []


@pytest.mark.browser
def test_the_report_shows_the_widget_without_a_kernel(browser: Browser, folder: Path) -> None:
    saved = sfkit.read_recipe(folder / "edited.safetensors")
    with opened(browser, folder / "report.html") as page:
        root = page.locator(".sfkit-inspector")
        weights = [float(text) for text in root.locator("[role=gridcell]").all_inner_texts()]
        assert weights == pytest.approx([w for row in saved.weights for w in row], abs=0.00501)
        drawn = "[...document.querySelectorAll('.sfkit figure img')].filter((i) => i.naturalWidth > 100)"
        page.wait_for_function(f"() => {drawn}.length === 4")
