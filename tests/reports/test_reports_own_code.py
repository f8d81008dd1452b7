"""A report on a pool whose code is the user's: what the command line trusts, the notebook's kernel runs."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_notebook
from own_networks import decorated, write_states

from sfkit.architectures import code
from sfkit.cli import main


def test_trust_reaches_the_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(code.TRUST, "")
    monkeypatch.setenv(code.CONFIG, str(tmp_path / "config"))
    write_states(tmp_path)
    cells = [
        new_code_cell('pool = ""', metadata={"tags": ["parameters"]}),
        new_code_cell("import sfkit\n\nprint('blocks:', *sfkit.open_pool(pool).blocks)"),
    ]
    nbformat.write(new_notebook(cells=cells), tmp_path / "own.ipynb")
    words = [tmp_path / "own.ipynb", "-p", "pool", decorated(tmp_path), "-o", tmp_path / "page.html"]
    with pytest.raises(SystemExit) as ended:
        main(["report", *map(str, words), "--trust-code"])
    assert not ended.value.code
    assert "blocks: features head" in (tmp_path / "page.html").read_text(encoding="utf-8")
