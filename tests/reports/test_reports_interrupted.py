"""A report that is killed or interrupted: nothing is in the way of the next one."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import papermill
import pytest
from nbformat import write
from nbformat.v4 import new_code_cell, new_notebook

from sfkit.cli import main
from sfkit.reports import report


@pytest.fixture
def book(tmp_path: Path) -> Path:
    cell = new_code_cell("count = 1", metadata={"tags": ["parameters"]})
    write(new_notebook(cells=[cell, new_code_cell("print(count)")]), tmp_path / "book.ipynb")
    return tmp_path / "book.ipynb"


class KilledError(BaseException):
    """Ends the process for all that runs in it."""


def test_a_killed_report_leaves_nothing(book: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(_: str, executed: str, *__: Any, **___: Any) -> None:
        Path(executed).touch()  # papermill was just opening it
        raise KilledError

    monkeypatch.setattr(papermill, "execute_notebook", killed)
    with pytest.raises(KilledError):
        report(book, {}, book.with_name("page.html"))
    assert list(book.parent.iterdir()) == [book]


def test_ctrl_c_leaves_a_report_and_ends_with_130(
    book: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(source: str, executed: str, *_: Any, **__: Any) -> None:
        shutil.copy(source, executed)
        raise KeyboardInterrupt

    monkeypatch.setattr(papermill, "execute_notebook", interrupted)
    page = book.with_name("page.html")
    page.with_suffix(".ipynb").touch()  # as one of an earlier version, killed, left it
    with pytest.raises(SystemExit) as ended:
        main(["report", str(book), "-o", str(page)])
    assert ended.value.code == 130
    assert capsys.readouterr().err.splitlines() == [
        "interrupted: what was evaluated is stored, start again to go on"
    ]
    assert "This run failed." in page.read_text()
    assert "KeyboardInterrupt" in page.read_text()
