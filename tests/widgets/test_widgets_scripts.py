"""The widgets' scripts: typed by JSDoc and checked strictly, their pure functions tested, without a browser.

Deno carries both the TypeScript compiler and what runs the tests; it comes from PyPI and asks no network.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
WIDGETS = HERE.parents[1] / "widgets"
SCRIPTS = sorted((WIDGETS / "sfkit_widgets").glob("*.js"))
TESTS = sorted((HERE / "scripts").glob("*.test.js"))


def deno(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run Deno with nothing kept outside of ``folder``."""
    found = pytest.importorskip("deno", reason="install the extra: pip install sfkit[dev]")
    settings = {"DENO_DIR": str(folder), "DENO_NO_UPDATE_CHECK": "1", "NO_COLOR": "1"}
    return subprocess.run(
        [found.find_deno_bin(), *arguments],
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        check=False,
    )


def test_there_are_scripts() -> None:
    assert {"_shared.js", "routing_inspector.js"} <= {path.name for path in SCRIPTS}
    assert TESTS


def test_scripts_are_typed(tmp_path: Path) -> None:
    options = ("--no-lock", "--no-remote", "--config", WIDGETS / "deno.json")
    done = deno(tmp_path, "check", *options, *SCRIPTS)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("path", TESTS, ids=lambda path: path.name)
def test_pure_functions(tmp_path: Path, path: Path) -> None:
    options = ("--no-lock", "--no-remote", "--no-check", "--config", WIDGETS / "deno.json")
    done = deno(tmp_path, "test", *options, path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| 0 passed" not in done.stdout
