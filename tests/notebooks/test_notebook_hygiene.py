"""Every notebook is committed clean, takes its parameters in one place, and explains more than it defines."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import nbformat
import pytest
from nbformat import NotebookNode

from sfkit import Compute

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
WORDS_PER_LINE = (6.0, 12.0)
EVALUATING = (
    *("Evaluator", "validation_scorer", "Experiment", "score_recipes", "measure_recipes"),
    *("data_similarity", "disparity_panels", "DisparityCompare"),
)
"""What runs networks, and has to be told where."""


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request: pytest.FixtureRequest) -> NotebookNode:
    return nbformat.read(request.param, as_version=4)


def code(notebook: NotebookNode) -> list[str]:
    return [cell.source for cell in notebook.cells if cell.cell_type == "code"]


def test_there_is_a_notebook() -> None:
    assert "01_quickstart" in [path.stem for path in NOTEBOOKS]


def test_it_holds_no_output_and_no_trace_of_a_run(notebook: NotebookNode) -> None:
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None
        assert set(cell.metadata) <= {"tags"}
    assert set(notebook.metadata) <= {"kernelspec", "language_info"}
    assert set(notebook.metadata.language_info) == {"name"}  # no version, which differs by machine


def test_one_cell_holds_the_parameters_as_plain_values(notebook: NotebookNode) -> None:
    tagged = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    assert len(tagged) == 1
    for statement in ast.parse(tagged[0].source).body:
        assert isinstance(statement, ast.Assign)
        ast.literal_eval(statement.value)


def test_its_tables_hold_names_as_text(notebook: NotebookNode) -> None:
    assert [source for source in code(notebook) if ".style." in source] == [], "analysis.shown escapes names"


def test_it_can_run_on_every_device_and_engine(notebook: NotebookNode) -> None:
    (parameters,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    values = {
        statement.targets[0].id: ast.literal_eval(statement.value)
        for statement in ast.parse(parameters.source).body
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)
    }
    given = {name: values[name] for name in ("device", "engine", "workers", "precision")}
    assert Compute(**given) == Compute(engine="auto")
    assert (
        sum("sfkit.Compute(device, engine, workers, precision)" in source for source in code(notebook)) == 1
    )
    for source in code(notebook):
        for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
            name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            assert name not in EVALUATING or "compute" in {keyword.arg for keyword in call.keywords}, name


def test_it_defines_nothing_but_the_network_one_brings(notebook: NotebookNode) -> None:
    for source in code(notebook):
        found = [
            node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef | ast.ClassDef)
        ]
        assert not found or "@sfkit.register_architecture(" in source


def test_prose_and_code_are_in_balance(notebook: NotebookNode) -> None:
    prose = " ".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    words = len(re.sub(r"```.*?```", "", prose, flags=re.DOTALL).split())
    lines = sum(bool(line.strip()) for source in code(notebook) for line in source.splitlines())
    assert WORDS_PER_LINE[0] <= words / lines <= WORDS_PER_LINE[1]


def test_it_lets_no_rendered_world_stand_in_for_a_users_benchmark(notebook: NotebookNode) -> None:
    """``bank.worlds`` refuses a pool of one's own without a benchmark: tests/bank/test_bank_worlds.py."""
    lines = "\n".join(code(notebook))
    if re.search(r"^pool = ", lines, re.MULTILINE):
        assert re.search(r"= bank\.worlds\(\s*pool, benchmark", lines)
