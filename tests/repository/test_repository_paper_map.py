"""docs/paper_map.md: each of the paper's labels stands there, each call can be imported, each cell found."""

from __future__ import annotations

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


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.label)
def test_the_call_can_be_imported_and_the_cell_found(row: Row) -> None:
    module, _, name = row.call.rpartition(".")
    assert callable(getattr(importlib.import_module(module), name))
    notebook, _, cell = row.cell.partition("#")
    cells = json.loads((ROOT / "notebooks" / f"{notebook}.ipynb").read_text(encoding="utf-8"))["cells"]
    assert cell in [entry["id"] for entry in cells if entry["cell_type"] == "code"]


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.label)
def test_the_result_has_a_command_that_records_it(row: Row) -> None:
    section = re.fullmatch(r"section `([a-z-]+)", row.result)
    assert section is not None, row.result
    assert (ROOT / "benchmarks" / "sections" / f"{section[1].replace('-', '_')}.py").is_file()
