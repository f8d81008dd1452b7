"""Notebook 05 on the embedded bank, its grids and budgets cut down: recorded results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import nbformat
import pandas as pd
import pytest
from nbformat import NotebookNode

from sfkit import EvaluationStore, Trim, open_pool, prepared_for, read_recipe
from sfkit.baselines import baseline_named, baselines
from sfkit.reports import report

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "05_baselines.ipynb"

PLOTLY = "application/vnd.plotly.v1+json"
# bad-3.0 in percent, recorded on a CPU with seed 1: on one validation pair, and on an unseen pair.
VALIDATION, UNSEEN = "courtyard (all-valid) bad-3.0 [%] *", "hazy-road (all-valid) bad-3.0 [%]"
RECORDED = {
    "single best (validation)": (5.288, 45.721),
    "single best (oracle)": (7.232, 37.992),
    "uniform": (5.930, 54.093),
    "task arithmetic": (5.793, 52.068),
    "greedy soup (>=)": (5.042, 54.239),
    "TIES": (6.409, 45.973),
    "DARE": (6.710, 53.569),
    "DARE + TIES": (6.311, 42.222),
    "Fisher": (7.213, 54.186),
    "AdaMerging (per source)": (8.831, 33.437),
    "AdaMerging (per block)": (8.946, 33.988),
    "random subsets": (5.370, 53.801),
    "Stage 1": (5.870, 53.642),
    "Stage 1+2": (5.736, 51.696),
}


@dataclass(frozen=True)
class Finished:
    """One run: the folder it wrote to, and the executed notebook."""

    folder: Path
    executed: NotebookNode


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    folder = tmp_path_factory.mktemp("baselines")
    values = {
        "quick": True,
        "benchmark_pairs": 1,
        "pool": "bank",
        "report_on": [{"name": "bank:hazy-road", "pairs": 1}],
        "seed": 1,
        "out": folder,
    }
    report(NOTEBOOK, values, folder / "report.html")
    return Finished(folder, nbformat.read(folder / "report.ipynb", as_version=4))


def test_the_table_holds_the_recorded_scores(finished: Finished) -> None:
    scores = pd.read_csv(finished.folder / "baselines.csv", index_col="network")
    for method, (validation, unseen) in RECORDED.items():
        assert scores.loc[method, VALIDATION] == pytest.approx(validation, abs=0.02), method
        assert scores.loc[method, UNSEEN] == pytest.approx(unseen, abs=0.02), method
    usual = [entry for entry in map(baseline_named, baselines()) if not entry.on_request]
    assert list(scores.index) == [entry.label for entry in usual]


def test_the_merged_file_knows_how_its_task_vectors_were_trimmed(finished: Finished) -> None:
    recipe = read_recipe(finished.folder / "trimmed.safetensors")
    assert recipe.preparation == (Trim(0.2),)
    assert all(name.endswith("/trim=0.2") for name in recipe.sources)
    rebuilt = prepared_for(open_pool("bank"), recipe)
    assert set(recipe.sources) <= set(rebuilt.names)


def test_the_report_answers_its_title(finished: Finished) -> None:
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    answer = (
        "Stage 1+2 comes 6th of 14 on what none of them was tuned on; with so few images no difference can "
        "be told from chance."
    )
    assert f"<title>{answer}</title>" in page
    scores = pd.read_csv(finished.folder / "baselines.csv", index_col="network")[UNSEEN]
    deployable = scores.drop("single best (oracle)")
    assert 1 + (deployable < deployable["Stage 1+2"]).sum() == 6
    outputs = [output for cell in finished.executed.cells for output in cell.get("outputs", [])]
    assert sum(PLOTLY in output.get("data", {}) for output in outputs) == 3


def test_nothing_was_evaluated_twice_and_nothing_complained(finished: Finished) -> None:
    outputs = [output for cell in finished.executed.cells for output in cell.get("outputs", [])]
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
    with EvaluationStore(finished.folder / "evaluations.sqlite") as store:
        keys = [evaluation.key for evaluation in store]
    assert len(keys) == len(set(keys)) > len(RECORDED)
