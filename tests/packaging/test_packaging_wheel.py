"""The wheel works as well as the checkout: built without a network, installed and run far from here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import nbformat
import pandas as pd
import pytest
from safetensors.torch import load_file

ROOT = Path(__file__).parents[2]
# Where a folder of the checkout stands in the wheel.
PLACES = {
    "sfkit": "sfkit",
    "widgets/sfkit_widgets": "sfkit_widgets",
    "data_manifests": "sfkit/data_manifests",
    "notebooks": "sfkit/notebook_files",
}
CACHES = {"__pycache__", ".ipynb_checkpoints"}


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command with its output, from another folder and without this process's import path.

    Jupyter looks for its templates in the running environment; ours lie in the one that is borrowed from.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    kept["JUPYTER_PATH"] = str(Path(sysconfig.get_path("data"), "share", "jupyter"))
    return subprocess.run(command, cwd=cwd, env=kept, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the source distribution, and the wheel built from it."""
    folder = tmp_path_factory.mktemp("dist")
    done = run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of a fresh environment that holds the wheel, and sees only what it depends on."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "env")
    programs = Path(sysconfig.get_path("scripts", "venv", {"base": str(folder / "env")}))
    install = (
        sys.executable,
        "-m",
        "pip",
        "--python",
        programs / "python",
        "install",
        "--no-deps",
        "--no-index",
    )
    done = run(*install, *built.glob("*.whl"), cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    # A path file adds this folder, but not the folders that its own path files name: the checkout stays out.
    packages = sysconfig.get_path("purelib", "venv", {"base": str(folder / "env")})
    Path(packages, "dependencies.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    return programs


def test_the_wheel_holds_every_file_of_the_packages(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    packed = set(zipfile.ZipFile(wheel).namelist())
    for folder, place in PLACES.items():
        files = [
            path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts
        ]
        assert files, folder
        assert {f"{place}/{path.relative_to(ROOT / folder).as_posix()}" for path in files} <= packed
    tops = {name.partition("/")[0] for name in packed}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"sfkit", "sfkit_widgets"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in packed)
    assert not any(name.startswith("sfkit/data_manifests/") and name.endswith(".py") for name in packed)


def test_the_source_distribution_can_be_worked_on(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"Makefile", "constraints.txt", "LICENSE", "README.md", "tests/conftest.py"} <= names


def test_both_packages_import_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    code = "import sfkit, sfkit_widgets; print(sfkit.__file__); print(sfkit_widgets.__file__)"
    done = run(installed / "python", "-W", "error", "-c", code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    places = [Path(line) for line in done.stdout.splitlines()]
    assert all(place.is_relative_to(installed.parent) for place in places), done.stdout


def test_the_command_runs_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    version = run(installed / "sfkit", "--version", cwd=tmp_path)
    assert version.returncode == 0, version.stderr
    assert version.stdout.startswith("sfkit ")
    usage = run(installed / "sfkit", "--help", cwd=tmp_path).stdout
    assert all(command in usage for command in ("search", "merge", "evaluate", "predict", "show", "report"))


def test_manifests_are_found_in_the_wheel(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = run(installed / "sfkit", "data", "check", "eth3d", "--root", "empty", cwd=tmp_path)
    assert "0 of 27" in done.stdout + done.stderr, done.stdout + done.stderr


@pytest.mark.slow
def test_the_demo_runs_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    """Both stages, computed outside the checkout: counted passes, a table, one network."""
    done = run(installed / "sfkit", "demo", "--json", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    table = pd.DataFrame.from_dict(found["table"], orient="index")
    assert [name.partition(" (")[0] for name in table.index] == [
        "base", "single best", "uniform", "Stage 1", "Stage 1+2",
    ]  # fmt: skip
    assert sum(column.endswith("*") for column in table) == 1
    guided = table.filter(like="*").iloc[:, 0]
    assert guided["Stage 1+2"] <= guided["Stage 1"] <= guided["uniform"]
    assert found["forward_passes"] > 1000, "the store was empty"
    assert table.min().min() > 1
    merged = load_file(tmp_path / "runs" / "demo" / "merged.safetensors")
    assert sum(tensor.numel() for tensor in merged.values()) > 30_000
    shown = run(installed / "sfkit", "show", "runs/demo/merged.safetensors", cwd=tmp_path)
    assert all(name in shown.stdout for name in found["subset"])


def test_a_notebook_becomes_a_page_by_the_wheel_s_template(installed: Path, tmp_path: Path) -> None:
    cell = nbformat.v4.new_code_cell("import sfkit\nprint(sfkit.__file__)")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("# Where am I?"), cell])
    nbformat.write(notebook, tmp_path / "small.ipynb")
    done = run(installed / "sfkit", "report", "small.ipynb", "-o", "page.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Where am I?" in page
    assert str(installed.parent) in page
