"""A factory replaces what a factory made, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from factory_files import write
from typer.testing import CliRunner

import sfkit
from sfkit.cli.app import app
from sfkit.factory import read_factory, run
from sfkit.factory.outputs import MADE_BY, ensure_own


@pytest.mark.parametrize("name", ["pool.toml", "scores.json", "costs.csv", "search/merged.safetensors"])
def test_files_that_no_factory_made_are_kept(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, "haze", "far-scene")
    (tmp_path / "search").mkdir()
    (tmp_path / name).write_text("mine")
    for call in (lambda: run(read_factory(path)), lambda: ensure_own(read_factory(path))):
        with pytest.raises(sfkit.InputError, match=rf"{name} exists, was made by no factory"):
            call()
    ended = CliRunner().invoke(app, ["factory", "run", str(path)])
    assert isinstance(ended.exception, sfkit.InputError)
    assert (tmp_path / name).read_text() == "mine"
    assert not (tmp_path / "sources").exists(), "nothing was trained"


def test_what_a_factory_made_it_may_replace(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene")
    (tmp_path / "pool.toml").write_text(f"{MADE_BY}name = 'before'")
    (tmp_path / "scores.json").write_text("{}")
    ensure_own(read_factory(path))


@pytest.mark.parametrize("words", [["--report", "x.txt"], ["--report", "sources"]])
def test_a_report_s_place_is_looked_at_before_the_trainings(
    tmp_path: Path, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, "haze", "far-scene")
    path.write_text(path.read_text().replace("evaluations = 0", "evaluations = 9"))
    monkeypatch.chdir(tmp_path)
    ended = CliRunner().invoke(app, ["factory", "run", str(path), *words])
    assert isinstance(ended.exception, sfkit.InputError)
    assert str(ended.exception).startswith("--report: ")
    assert not (tmp_path / "sources").exists()


def test_a_factory_s_file_is_not_taken_for_its_pool(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene").rename(tmp_path / "pool.toml")
    ended = CliRunner().invoke(app, ["factory", "run", str(path)])
    assert "pool.toml is the file that FILE names" in str(ended.exception)
