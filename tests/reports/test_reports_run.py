"""Runs of small notebooks: what is written, what is said on the way, and what a failure leaves behind."""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from sfkit.reports import ReportError, report

HIDDEN_CODE = "answer = 6 * count"


def write(path: Path, *sources: str) -> Path:
    """A notebook of these code cells below a heading, the first of them its parameters."""
    first, *rest = sources
    cells = [new_markdown_cell("# Counting & more"), new_code_cell(first, metadata={"tags": ["parameters"]})]
    path.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(new_notebook(cells=[*cells, *map(new_code_cell, rest)]), path)
    return path


def outputs(path: Path) -> str:
    """All that the executed notebook's cells printed."""
    cells = nbformat.read(path, as_version=4).cells
    return "".join(o.text for cell in cells for o in cell.get("outputs", []) if o.output_type == "stream")


def test_a_run_leaves_page_and_executed_notebook(tmp_path: Path) -> None:
    source = write(
        tmp_path / "in{1}" / "count.ipynb",
        "count = 1",
        f"{HIDDEN_CODE}\nprint('<b>', answer)\nprint('half', end='')",
        "import os, sys\nprint(sys.executable, os.getcwd(), os.environ['SFKIT_HEADLESS'])",
        "import tqdm\nfor _ in tqdm.tqdm(range(3)):\n    pass",
    )
    before = source.read_bytes()
    lines: list[str] = []
    out = tmp_path / "new" / "out{2}.html"

    assert report(source, {"count": 7}, out, progress=lines.append) == out

    assert source.read_bytes() == before
    assert sorted(path.name for path in out.parent.iterdir()) == ["out{2}.html", "out{2}.ipynb"]
    assert outputs(out.with_suffix(".ipynb")) == f"<b> 42\nhalf{sys.executable} {Path.cwd()} 1\n"
    assert lines == [
        "cell 1 of 4: count = 1",
        f"cell 2 of 4: {HIDDEN_CODE}",
        "    <b> 42",
        "    half",
        "cell 3 of 4: import os, sys",
        f"    {sys.executable} {Path.cwd()} 1",
        "cell 4 of 4: import tqdm",
    ]
    page = out.read_text(encoding="utf-8")
    assert "<title>Counting &amp; more</title>" in page
    assert "&lt;b&gt; 42" in page
    assert "<b> 42" not in page
    assert "finished in" in page
    assert "plotly" not in page.lower(), "without a figure the page needs no plotly.js"


def test_a_report_can_be_written_again(tmp_path: Path) -> None:
    source = write(tmp_path / "count.ipynb", "count = 1", "print(count)")
    out = tmp_path / "out.html"
    report(source, {"count": 2}, out)
    report(source, {"count": 3}, out)
    assert outputs(out.with_suffix(".ipynb")) == "3\n"


def test_a_failing_cell_is_shown_and_named(tmp_path: Path) -> None:
    source = write(
        tmp_path / "count.ipynb",
        "count = 1",
        "print('before')",
        "raise ValueError('no <such> thing\\nsecond line')",
        "print('after')",
    )
    out = tmp_path / "out.html"
    with pytest.raises(ReportError) as caught:
        report(source, {"count": 2}, out)
    expected = f"{source}: cell 3 of 4 failed with ValueError: no <such> thing; {out} shows it"
    assert str(caught.value) == expected
    assert caught.value.report == out
    page = out.read_text(encoding="utf-8")
    assert "ValueError: no &lt;such&gt; thing" in page
    assert "<such>" not in page
    assert page.count("celltag_failed") == 1 + page[: page.index("<body>")].count("celltag_failed")
    assert outputs(out.with_suffix(".ipynb")) == "before\n"


def test_a_dead_kernel_leaves_a_report(tmp_path: Path) -> None:
    source = write(tmp_path / "count.ipynb", "count = 1", "print('before')", "import os; os._exit(3)")
    out = tmp_path / "out.html"
    with pytest.raises(
        ReportError, match=r"cell 3 of 3 failed with DeadKernelError: Kernel died; .*out\.html"
    ):
        report(source, {}, out)
    page = out.read_text(encoding="utf-8")
    assert "This run failed." in page
    assert "before" in page
