"""Every notebook is committed clean, takes its parameters in one place, and explains more than it defines."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import nbformat
import pytest
from nbformat import NotebookNode

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
WORDS_PER_LINE = (6.0, 12.0)


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
