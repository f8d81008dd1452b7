"""Linear paths: barriers and harm from scores, and on real networks the two sources that do harm."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import pandas as pd
import pytest
import tiny
import torch
from safetensors.torch import save_file

import sfkit
from sfkit.analysis import LinearPaths, linear_paths
from sfkit.analysis.linear_path import Path as Line
from sfkit.cli import main
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging.recognition import family, recognised


def test_the_middle_is_half_of_each(tmp_path: Path) -> None:
    pool = sfkit.open_pool(tiny.write_pool(tmp_path, sources=2))
    evaluator = sfkit.Evaluator(pool, sfkit.open_benchmark("pairs", tiny.write_pairs(tmp_path / "pairs")))
    found = linear_paths(evaluator)
    assert [(path.start, path.end) for path in found.paths] == [("base", "a"), ("base", "b"), ("a", "b")]
    (half,) = evaluator([sfkit.Recipe.weighted({"a": 0.5}, pool.blocks)])
    assert found.paths[0].scores[1] == half.score
    assert found.paths[2].scores == tuple(
        outcome.score for outcome in evaluator([pool.equal("a"), pool.equal("a", "b"), pool.equal("b")])
    )
    assert len(found.table()) == 3
    members = found.beside(pool.summary())
    assert list(members["file"]) == list(pool.summary()["file"])
    scores = [found.paths[0].scores[0], *(path.scores[2] for path in found.paths[:2])]
    assert list(members["score"]) == scores
    assert list(members["half"][1:]) == [path.scores[1] for path in found.paths[:2]]


def test_the_command_shows_the_lines_in_the_pools_summary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pool, pairs = tiny.write_pool(tmp_path, sources=2), tiny.write_pairs(tmp_path / "pairs")
    documents = []
    for words in (["--json"], []):
        with pytest.raises(SystemExit) as ended:
            main(["check", str(pool), "-b", "pairs", "--root", str(pairs), *words])
        assert not ended.value.code
        documents.append(capsys.readouterr().out)
    told = json.loads(documents[0])
    assert [member["name"] for member in told["members"]] == ["base", "a", "b"]
    assert told["members"][0]["half"] is None
    assert {member["line"] for member in told["members"][1:]} <= {"low", "barrier", "harms"}
    assert told["sentences"][0] in documents[1]
    assert "cosine to base" in documents[1]


def test_barriers_and_harm_by_hand() -> None:
    sound, blocked = Line("base", "a", (10.0, 9.0, 12.0)), Line("a", "b", (12.0, 20.0, 11.0))
    harmful, broken = Line("base", "b", (10.0, 18.0, 40.0)), Line("base", "c", (10.0, math.inf, math.inf))
    assert sound.barrier == -2.0
    assert blocked.barrier == 8.5
    found = LinearPaths((sound, harmful, broken, blocked), "px")
    assert found.harmful == ("b", "c")
    assert len(found.sentences) == 3
    assert "between a and b lies a barrier: 12.00 and 11.00 px at the ends, 20.00" in found.sentences[2]
    members = found.beside(pd.DataFrame({"file": list("xyz")}, index=["base", "a", "b"]))
    assert members["line"].tolist() == ["", "low", "harms"]
    assert members["score"].tolist() == [10.0, 12.0, 40.0]
    assert LinearPaths((sound,), "px").sentences[0].startswith("every straight line stays low")


def real_pool(folder: Path, real_data: Path) -> Path:
    """A copy of the real checkpoints."""
    folder.mkdir()
    for path in (real_data / "anynet").glob("*.tar"):
        shutil.copy(path, folder)
    return folder


def test_init_finds_the_base_and_the_paths_the_two_that_harm(
    tmp_path: Path, real_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = real_pool(tmp_path / "anynet", real_data)
    told = {}
    for words in (["init", folder, "--json"], ["show", folder / "ft_kitti2012_official.tar", "--json"]):
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        assert not ended.value.code
        told[words[0]] = json.loads(capsys.readouterr().out)
    assert (told["init"]["architecture"], told["init"]["base"]) == ("anynet", "base_sceneflow.tar")
    assert set(told["init"]["sources"]) == {path.name for path in folder.glob("ft_*.tar")}
    assert len(told["init"]["sources"]) == 6
    assert not told["init"]["skipped"]
    assert "anynet" in json.dumps(told["show"])
    written = (folder / "pool.toml").read_text()
    assert written.count("licence = ") == 7
    with pytest.warns(SfkitWarning, match="lacks 6 optional"):
        pool = sfkit.open_pool(folder)
    pairs = real_data / "pairs" / "cones"
    (tmp_path / "pairs.csv").write_text(
        f"left,right,disparity,coding\n{pairs / 'im2.png'},{pairs / 'im6.png'},{pairs / 'disp2.png'},png8:4\n"
    )
    benchmark = sfkit.open_benchmark("pairs", pairs, table=tmp_path / "pairs.csv", metric="bad-1.0")
    paths = linear_paths(sfkit.Evaluator(pool, benchmark), between=False)
    assert set(paths.harmful) == {"ft_kitti2015_half_kasatkin", "ft_own_zakariya"}


def test_the_base_of_a_cluster_is_known_by_its_name(tmp_path: Path) -> None:
    base = {key: value for key, value in tiny.base_state().items() if value.is_floating_point()}
    first, second = tiny.fine_tune(base, 1), tiny.fine_tune(base, 2)
    further = {key: value + (value - base[key]) * 3e-2 for key, value in first.items()}
    # As far as distances go, the first could be the base of all others.
    states = {"sceneflow": base, "kitti": first, "kitti_new": further, "drive": {}}
    states["drive"] = {k: base[k] + 0.5 * (first[k] - base[k]) + 0.87 * (second[k] - base[k]) for k in base}
    for name, state in states.items():
        save_file({key: value.contiguous() for key, value in state.items()}, tmp_path / f"{name}.safetensors")
    assert family(tmp_path).base.name == "sceneflow.safetensors"
    (tmp_path / "sceneflow.safetensors").rename(tmp_path / "zero.safetensors")
    assert family(tmp_path).base.name == "kitti.safetensors", "by distances alone"
    assert family(tmp_path, "zero.safetensors").base.name == "zero.safetensors"
    with pytest.raises(
        InputError, match=r"unknown --base 'zer.safetensors', expected one of: .* did you mean"
    ):
        family(tmp_path, "zer.safetensors")


def test_recognition_refuses_what_it_does_not_know(tmp_path: Path) -> None:
    for name in ("base", "a"):
        save_file({"some.weight": torch.ones(2, 3)}, tmp_path / f"{name}.safetensors")
    with pytest.raises(InputError, match="found 0 checkpoints of one known architecture"):
        family(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        family(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="found 0 checkpoints, expected a base"):
        family(tmp_path / "empty")
    assert recognised(tmp_path / "base.safetensors") == ()
