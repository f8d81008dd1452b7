"""docs/paper_map.md: each label of the paper; each cell calls what is named, each section holds the thing."""

from __future__ import annotations

import ast
import importlib
import json
import re
from pathlib import Path
from typing import NamedTuple

import pytest

from sfkit.published import LABELS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "paper_map.md"


class Row(NamedTuple):
    label: str
    what: str
    call: str
    cell: str
    result: str


def rows() -> list[Row]:
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    return [Row(*(part.strip().strip("`") for part in line.strip("|").split("|"))) for line in lines]


def test_every_label_of_the_paper_stands_there_once(goldens: Path) -> None:
    text = (goldens / "stereofactory.tex").read_text(encoding="utf-8")
    visible = "\n".join(re.split(r"(?<!\\)%", line)[0] for line in text.splitlines())
    labels = re.findall(r"\\label\{((?:tab|fig|alg):[^}]+)\}", visible)
    assert sorted(row.label for row in rows()) == sorted(labels)


def test_every_transcribed_table_stands_there() -> None:
    assert {row.label for row in rows()} >= set(LABELS)


def found(path: str) -> object:
    """What a dotted path names: a module's function, or a class's method."""
    parts = path.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            held: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for name in parts[cut:]:
            held = getattr(held, name)
        return held
    raise AssertionError(f"no module of {path} can be imported")


def called(source: str) -> set[str]:
    """What a cell calls, as it is written there: ``analysis.study``, ``study.table``."""
    return {ast.unparse(node.func) for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)}


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.label)
def test_the_named_cell_calls_the_named_function(row: Row) -> None:
    assert callable(found(row.call))
    notebook, _, cell = row.cell.partition("#")
    cells = json.loads((ROOT / "notebooks" / f"{notebook}.ipynb").read_text(encoding="utf-8"))["cells"]
    (source,) = ["".join(c["source"]) for c in cells if c["cell_type"] == "code" and c["id"] == cell]
    # A method is called on a variable that bears its class's name in small letters.
    *_, owner, name = row.call.split(".")
    assert f"{owner.lower()}.{name}" in called(source), sorted(called(source))


def tables(section: str) -> list[set[str]]:
    """The cells of each table of one section of the results."""
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    (part,) = re.findall(f"<!-- begin {section} -->(.*?)<!-- end {section} -->", text, re.DOTALL)
    blocks = re.findall(r"(?:^\|.*\n)+", part, re.MULTILINE)
    return [
        {c.strip() for line in block.splitlines() for c in line.strip("|").split("|")} for block in blocks
    ]


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.label)
def test_the_result_is_where_the_map_says(row: Row) -> None:
    if row.result in ("nothing is measured", "not recorded yet"):
        return
    if file := re.fullmatch(r"file `([^`]+)", row.result):
        assert (ROOT / "docs" / file[1]).is_file()
        return
    section = re.fullmatch(r"section `([a-z-]+)`: (.+)", row.result)
    assert section is not None, row.result
    file = f"{section[1].replace('-', '_')}.py"
    assert any((ROOT / "benchmarks" / folder / file).is_file() for folder in (".", "sections"))
    words = section[2].split("; ")
    held = [cells for cells in tables(section[1]) if all(any(c.startswith(w) for c in cells) for w in words)]
    assert held, f"no table of {section[1]} holds {words}"
