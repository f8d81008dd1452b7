"""What is in the repository: nothing of one machine, notebooks without outputs, files of one sitting."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Put together from pieces, so that this file does not find itself.
MACHINE = re.compile(r"(?<![\w.])/(?:" + "|".join(("work", "farm", "root", "tmp")) + r")/[A-Za-z.]")
REGISTRY = re.compile(
    "|".join(("index" + "-url", r"pypi\." + "org", "pythonhosted" + r"\.", "npmjs" + r"\."))
)
LEFTOVER = re.compile("raise NotImplemented|TO" + r"DO\b|FIX" + r"ME\b|except( Exception)?:\s*(pass)?$", re.M)
LONGEST = 400
LARGEST = 1_500_000


def repository() -> list[Path]:
    """All files of the repository: tracked, or new and not ignored."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [path for name in listed.split("\0") if name and (path := ROOT / name).is_file()]


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """Path within the repository -> text, of every text file."""
    found: dict[str, str] = {}
    for path in repository():
        content = path.read_bytes()
        if b"\0" not in content:
            found[path.relative_to(ROOT).as_posix()] = content.decode("utf-8")
    assert "pyproject.toml" in found
    return found


def matches(texts: dict[str, str], pattern: re.Pattern[str]) -> list[str]:
    """``file:line: text`` of all that match."""
    return [
        f"{name}:{text.count(chr(10), 0, found.start()) + 1}: {found.group()}"
        for name, text in texts.items()
        for found in pattern.finditer(text)
    ]


def test_no_file_knows_one_machine(texts: dict[str, str]) -> None:
    assert matches(texts, MACHINE) == []


def test_no_file_names_a_package_registry(texts: dict[str, str]) -> None:
    assert matches(texts, REGISTRY) == []


def test_nothing_is_left_over(texts: dict[str, str]) -> None:
    code = {name: text for name, text in texts.items() if name.startswith(("sfkit/", "widgets/"))}
    assert matches(code, LEFTOVER) == []


def test_code_files_can_be_read_in_one_sitting(texts: dict[str, str]) -> None:
    code = {name: text for name, text in texts.items() if name.startswith(("sfkit/", "widgets/"))}
    lengths = {name: text.count("\n") for name, text in code.items() if name.endswith((".py", ".js", ".css"))}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}


def test_no_file_is_large() -> None:
    sizes = {path.relative_to(ROOT).as_posix(): path.stat().st_size for path in repository()}
    assert {name: size for name, size in sizes.items() if size > LARGEST} == {}


def test_notebooks_carry_no_results(texts: dict[str, str]) -> None:
    for name, text in texts.items():
        if not name.endswith(".ipynb"):
            continue
        notebook = json.loads(text)
        assert not {"papermill", "widgets"} & set(notebook["metadata"]), name
        for cell in notebook["cells"]:
            assert "papermill" not in cell["metadata"], name
            assert not cell.get("outputs"), f"{name}: run make lint, or nbstripout"
            assert cell.get("execution_count") is None, name


def test_make_and_pre_commit_strip_the_same(texts: dict[str, str]) -> None:
    options = re.compile(r'--keep-id --extra-keys "([^"]*)"')
    found = [options.search(texts[name]) for name in ("Makefile", ".pre-commit-config.yaml")]
    assert all(found)
    assert len({match.group(1) for match in found if match}) == 1


def test_the_readme_names_every_task_and_command(texts: dict[str, str]) -> None:
    for name in re.findall(r"^([a-z-]+):.*## ", texts["Makefile"], re.M):
        assert f"make {name}" in texts["README.md"] + texts["CONTRIBUTING.md"]
    for command in ("search", "merge", "evaluate", "baselines", "predict", "show", "data check", "report"):
        assert f"sfkit {command}" in texts["README.md"]
    assert texts["README.md"].count("\n") < 120, "what it says more belongs to docs/guide.md"
