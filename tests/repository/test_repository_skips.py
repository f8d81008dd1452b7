"""Where SFKIT_REQUIRE_ALL=1, nothing is skipped green: the rule of tests/conftest.py, seen from outside."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"

SKIPPING = {
    "in the test": "import pytest\ndef test_it():\n    pytest.skip('no disk')\n",
    "by mark": "import pytest\n@pytest.mark.skipif(True, reason='no disk')\ndef test_it(): pass\n",
    "in a fixture": "import pytest\n@pytest.fixture\ndef a(): pytest.skip('no disk')\ndef test_it(a): ...\n",
    "whole module": "import pytest\npytest.importorskip('no_module', reason='no disk')\ndef test_it(): ...\n",
}


def run(folder: Path, source: str, *options: str, **variables: str) -> tuple[int, str]:
    """Exit code and output of pytest over one test file beside a copy of the conftest."""
    (folder / "conftest.py").write_text(CONFTEST.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "test_sample.py").write_text(source, encoding="utf-8")
    # Only the plug-ins of pytest itself: a second's start is most of what these tests cost.
    variables["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("SFKIT_", "PYTEST_"))}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, str(folder)]
    done = subprocess.run(
        command, cwd=folder, env=kept | variables, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    """Both data folders, there and empty."""
    data = tmp_path / "data"
    data.mkdir()
    return {"SFKIT_REAL_DATA": str(data), "SFKIT_GOLDENS": str(data)}


@pytest.mark.parametrize("source", SKIPPING.values(), ids=SKIPPING.keys())
def test_a_skip_fails_only_where_all_is_required(
    tmp_path: Path, folders: dict[str, str], source: str
) -> None:
    code, output = run(tmp_path, source)
    assert code in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}, output
    code, output = run(tmp_path, source, SFKIT_REQUIRE_ALL="1", **folders)
    assert code not in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}, output
    assert "skipped although SFKIT_REQUIRE_ALL=1" in output
    assert "no disk" in output


def test_a_skip_on_the_list_passes(tmp_path: Path, folders: dict[str, str]) -> None:
    listed = "import conftest\nconftest.ALLOWED_SKIPS['test_sample.py::test_it'] = 'the disk is optional'\n"
    code, output = run(tmp_path, listed + SKIPPING["in the test"], SFKIT_REQUIRE_ALL="1", **folders)
    assert code == pytest.ExitCode.OK, output
    assert "1 skipped" in output


def test_an_expected_failure_stays_one(tmp_path: Path, folders: dict[str, str]) -> None:
    source = "import pytest\n@pytest.mark.xfail\ndef test_it():\n    assert False\n"
    code, output = run(tmp_path, source, SFKIT_REQUIRE_ALL="1", **folders)
    assert code == pytest.ExitCode.OK, output


@pytest.mark.parametrize("missing", ["SFKIT_REAL_DATA", "SFKIT_GOLDENS"])
@pytest.mark.parametrize("value", [None, "nowhere"])
def test_a_missing_data_folder_ends_the_run(
    tmp_path: Path, folders: dict[str, str], missing: str, value: str | None
) -> None:
    rest = {name: folder for name, folder in folders.items() if name != missing}
    given = rest if value is None else rest | {missing: str(tmp_path / value)}
    code, output = run(tmp_path, "def test_it(): pass\n", SFKIT_REQUIRE_ALL="1", **given)
    assert code == pytest.ExitCode.USAGE_ERROR, output
    assert missing in output


def test_a_folder_that_is_not_there_fails_even_where_not_all_is_required(tmp_path: Path) -> None:
    source = "def test_it(goldens): pass\n"
    code, output = run(tmp_path, source, SFKIT_GOLDENS=str(tmp_path / "nowhere"))
    assert code == pytest.ExitCode.TESTS_FAILED, output
    assert "which is no folder" in output


def test_slow_tests_are_a_choice(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    slow: slow\n", encoding="utf-8")
    source = "import pytest\n@pytest.mark.slow\ndef test_slow(): pass\ndef test_quick(): pass\n"
    assert "1 passed, 1 deselected" in run(tmp_path, source)[1]
    assert "2 passed" in run(tmp_path, source, "--slow")[1]
