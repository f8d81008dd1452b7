"""The quickstart and the report with two worker processes: every evaluation and every table as with one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pandas as pd
import pytest

from sfkit import EvaluationStore
from sfkit.reports import report

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
SMALL: dict[str, Any] = {
    "pool": "bank",
    "benchmark_pairs": 2,
    "report_on": [{"name": "bank:hazy-road", "pairs": 1}],
    "population": 4,
    "generations": 1,
    "evaluations": 5,
    "seed": 1,
}
REPORT = {**SMALL, "seeds": 1, "methods": ["uniform", "stage1"], "source_pairs": 1}
CLOCK = ("seconds", "cost", "overhead", "environment")
"""Tables of what the clock decides, and of the machine."""


def run(folder: Path, notebook: str, values: dict[str, Any]) -> Path:
    report(NOTEBOOKS / f"{notebook}.ipynb", {**values, "out": folder}, folder / "page.html")
    return folder


def evaluations(folder: Path) -> dict[str, Any]:
    with EvaluationStore(folder / "evaluations.sqlite") as store:
        return {e.key: (e.description, [image.to_dict() for image in e.images], e.failure) for e in store}


def tables(folder: Path) -> dict[str, str]:
    found = [path for path in sorted(folder.rglob("*.csv")) if path.stem not in CLOCK]
    return {path.name: pd.read_csv(path).to_csv() for path in found}


def printed(folder: Path) -> str:
    cells = nbformat.read(folder / "page.ipynb", as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.output_type == "stream")


@pytest.mark.parametrize(
    ("notebook", "values"),
    [("01_quickstart", SMALL), pytest.param("report", REPORT, marks=pytest.mark.slow)],
)
def test_two_processes_give_what_one_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, notebook: str, values: dict[str, Any]
) -> None:
    # The last bits of a convolution can hang on the number of threads: one here, one in each worker.
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    alone = run(tmp_path / "alone", notebook, values)
    together = run(tmp_path / "together", notebook, {**values, "workers": 2})
    assert evaluations(together) == evaluations(alone) != {}
    assert tables(together) == tables(alone) != {}
    said = {folder: printed(folder) + environment(folder) for folder in (alone, together)}
    assert " 2 at a time" in said[together] or "2 workers on cpu" in said[together]
    assert "2 at a time" not in said[alone]
    assert "2 workers" not in said[alone]


def environment(folder: Path) -> str:
    """What a report says of the machine; nothing in the quickstart."""
    found = folder / "tables" / "environment.csv"
    return found.read_text(encoding="utf-8") if found.exists() else ""
