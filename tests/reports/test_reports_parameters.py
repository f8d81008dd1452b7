"""The parameters of a notebook: names from its syntax tree, values checked by name and kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from sfkit.errors import InputError
from sfkit.reports import notebook_parameters, read_parameters, report

CELL = """
# What to search
pool = ""  # the pool's file, e.g. "a=b"
budget: int = 750
rate, seed = 0.3, 0
noise = -0.5
flags = {"full": True}
benchmarks = [
    "kitti2012",
    "pairs",
]
limit = None
quick = False
where = len(pool) == 0
"""

Write = Callable[[str | None], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a notebook whose parameters cell holds the given source (None: it has no such cell)."""

    def writer(source: str | None) -> Path:
        cells = [new_markdown_cell("# Title")]
        if source is not None:
            cells.append(new_code_cell(source, metadata={"tags": ["parameters"]}))
        path = tmp_path / "sample.ipynb"
        nbformat.write(new_notebook(cells=cells), path)
        return path

    return writer


def test_every_plain_assignment_is_a_parameter(write: Write) -> None:
    assert notebook_parameters(write(CELL)) == {
        "pool": "",
        "budget": 750,
        "noise": -0.5,
        "flags": {"full": True},
        "benchmarks": ["kitti2012", "pairs"],
        "limit": None,
        "quick": False,
        "where": None,
    }


def test_a_notebook_without_a_parameters_cell_takes_none(write: Write) -> None:
    assert notebook_parameters(write(None)) == {}


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("pool", "12", "12"),
        ("pool", "true", "true"),
        ("budget", "12", 12),
        ("noise", "1e-3", 0.001),
        ("quick", "true", True),
        ("quick", "True", True),
        ("benchmarks", '["eth3d"]', ["eth3d"]),
        ("limit", "30", 30),
        ("limit", "a b", "a b"),
        ("budget", "None", None),
    ],
)
def test_text_becomes_a_value_of_the_default_s_kind(write: Write, name: str, text: str, value: Any) -> None:
    read = read_parameters(write(CELL), {name: text})
    assert read == {name: value}
    assert type(read[name]) is type(value)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        (
            "budgte",
            "12",
            "unknown parameter of sample.ipynb 'budgte', expected one of: .*did you mean 'budget'",
        ),
        (
            "budget",
            "many",
            "parameter 'budget' is the string 'many', expected a number such as its default 750",
        ),
        ("quick", "1", "parameter 'quick' is the number 1, expected a boolean such as its default False"),
        ("benchmarks", "eth3d", "parameter 'benchmarks' is the string 'eth3d', expected a list"),
        ("flags", "[]", "parameter 'flags' is the list .*, expected a dict"),
    ],
)
def test_a_wrong_name_or_kind_is_refused(write: Write, name: str, text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        read_parameters(write(CELL), {name: text})


def test_paths_and_tuples_become_what_a_cell_can_hold(write: Write, tmp_path: Path) -> None:
    source = "folder = ''\nsizes = [1]\n"
    path = write(source)
    out = report(path, {"folder": tmp_path, "sizes": (2, 3)}, tmp_path / "out.html")
    cells = nbformat.read(out.with_suffix(".ipynb"), as_version=4).cells
    injected = next(cell for cell in cells if "injected-parameters" in cell.metadata.get("tags", []))
    values: dict[str, Any] = {}
    exec(injected.source, values)  # noqa: S102 - papermill's own two assignments
    assert values["folder"] == str(tmp_path)
    assert values["sizes"] == [2, 3]


def refused(parameters: dict[str, Any], notebook: Path, out: Path, sentence: str) -> None:
    """The report is refused with that sentence, and nothing new stands anywhere."""
    top = notebook.parent
    before = sorted(top.rglob("*"))
    with pytest.raises(InputError, match=sentence):
        report(notebook, parameters, out)
    assert sorted(top.rglob("*")) == before


def test_nothing_is_run_or_written_where_something_is_wrong(write: Write, tmp_path: Path) -> None:
    good = write(CELL)
    refused({"budgte": 3}, good, tmp_path / "new" / "out.html", "did you mean 'budget'")
    refused({"budget": object()}, good, tmp_path / "new" / "out.html", "found a object, expected a string")
    refused({}, good, tmp_path / "out.pdf", "found the ending '.pdf', expected a report that ends in .html")
    refused({}, good, tmp_path / "sample.html", "would overwrite .*sample.ipynb, which no report wrote")
    refused({}, good, good / "out.html", "is no folder that can be written to")
    refused({}, tmp_path / "absent.ipynb", tmp_path / "out.html", "absent.ipynb: the notebook cannot be read")
    refused({}, tmp_path / "sample.py", tmp_path / "out.html", "expected a notebook that ends in .ipynb")
    folder = tmp_path / "folder.html"
    folder.mkdir()
    refused({}, good, folder, "found a folder, expected the name of the HTML file to write")
    (tmp_path / "mine.ipynb").write_text(good.read_text(encoding="utf-8"), encoding="utf-8")
    refused({}, good, tmp_path / "mine.html", "would overwrite .*mine.ipynb, which no report wrote")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "not a Jupyter notebook"),
        ("print('hello')", "not a Jupyter notebook"),
        ("{}", "not a Jupyter notebook"),
        (
            json.dumps({"cells": 3, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}),
            "not a Jupyter notebook",
        ),
    ],
)
def test_a_file_that_is_no_notebook_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "broken.ipynb"
    path.write_text(text, encoding="utf-8")
    refused({}, path, tmp_path / "out.html", sentence)


def test_broken_python_among_the_parameters_is_refused(write: Write, tmp_path: Path) -> None:
    refused({}, write("budget = = 3"), tmp_path / "out.html", "the cell tagged 'parameters' is no Python")


def test_another_language_is_refused(tmp_path: Path) -> None:
    spec = {"name": "julia", "display_name": "Julia", "language": "julia"}
    path = tmp_path / "other.ipynb"
    nbformat.write(new_notebook(metadata={"kernelspec": spec}), path)
    refused({}, path, tmp_path / "out.html", "found a notebook in julia, expected Python")
