"""The full report by its command, and what it wrote, for the sections that record it."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import nbformat
import pandas as pd
from commands import sfkit

from sfkit.analysis import markdown_table


@dataclass(frozen=True)
class FullReport:
    """One report, made with nothing in the store.

    Attributes:
        folder: where it and its tables lie.
        minutes: what it took.
    """

    folder: Path
    minutes: float

    def table(self, name: str, index: str) -> pd.DataFrame:
        """One of its tables."""
        return pd.read_csv(self.folder / "tables" / f"{name}.csv", index_col=index)

    def summary(self) -> str:
        """Its sentences, as a Markdown list."""
        notebook = nbformat.read(self.folder / "report.ipynb", as_version=4)
        cell = next(cell for cell in notebook.cells if cell.id == "summary")
        return str(next(output.data["text/markdown"] for output in cell.outputs if "data" in output))


def make(folder: Path, parameters: Mapping[str, object]) -> FullReport:
    """Run ``sfkit report`` with these parameters; a store of before is removed first."""
    shutil.rmtree(folder, ignore_errors=True)
    values = {**parameters, "out": str(folder)}
    words = [w for name, value in values.items() for w in ("-p", name, _text(value))]
    started = time.perf_counter()
    sfkit("report", "report", *words, "-o", str(folder / "report.html"))
    return FullReport(folder, (time.perf_counter() - started) / 60)


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """A table as Markdown, nothing marked; a number that is missing is a dash."""
    return markdown_table(table, columns=(), digits=digits).strip()


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
