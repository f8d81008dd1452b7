"""Several networks at once: `evaluate` and `compare`; and what `merge`, `search` and `open` say."""

from __future__ import annotations

import io
import math
import subprocess
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest
import torch
from cli_world import Shell, rename_sources
from safetensors.torch import load_file
from tiny import write_pairs, write_pool

import sfkit
from sfkit.analysis.labels import Judgement
from sfkit.cli.evaluate import _document
from sfkit.colours import ERROR, lookup
from sfkit.evaluation import Estimate, prediction_files

PAIRS = "-b pairs -r pairs"


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    """A folder with a pool and six pairs."""
    rename_sources(write_pool(tmp_path / "pool"))
    write_pairs(tmp_path / "pairs", 6)
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


def test_evaluate_several_networks_metrics_and_images(shell: Shell) -> None:
    shell("merge pool --weights kitti=0.25,indoor=0.75 -o mix.safetensors")
    shell("merge pool --subset kitti,indoor -o half.safetensors")
    line = (
        f"evaluate pool {PAIRS} --recipe mix.safetensors --recipe half.safetensors --metric d1,epe --images"
    )
    document = shell.json(line)
    scores = {(row["network"], row["metric"]): row["score"] for row in document["scores"]}
    networks = ("mix.safetensors", "half.safetensors")
    assert list(scores) == [(network, metric) for network in networks for metric in ("d1", "epe")]
    for (network, metric), score in scores.items():
        of_images = [
            r["score"] for r in document["images"] if (r["network"], r["metric"]) == (network, metric)
        ]
        assert len(of_images) == 6
        assert math.fsum(of_images) / 6 == pytest.approx(score), "all-valid is the mean over images"
    alone = shell.json(f"evaluate pool {PAIRS} --recipe half.safetensors --metric d1")["scores"]
    assert [row["score"] for row in alone] == [scores["half.safetensors", "d1"]], "no metric changes another"
    text, _ = shell(f"{line} -o images.csv")
    assert text.splitlines()[1].split() == ["network", "image", "d1", "[%]", "epe", "[px]"]
    expected = [row["score"] for row in document["images"]]
    assert pd.read_csv("images.csv")["score"].tolist() == pytest.approx(expected)


@pytest.mark.parametrize(("metrics", "best"), [(("d1", "epe"), "a"), (("epe", "d1"), "b")])
def test_the_best_of_several_metrics_is_that_of_the_first(metrics: tuple[str, str], best: str) -> None:
    """Percent and pixels are not ranked in one list, where the few pixels would win."""
    values = {("a", "d1"): 10.0, ("b", "d1"): 20.0, ("a", "epe"): 2.0, ("b", "epe"): 1.0}
    rows = [(network, metric, values[network, metric]) for network in "ab" for metric in metrics]
    scores = pd.DataFrame(rows, columns=["network", "metric", "score"])
    described = SimpleNamespace(name="pool", benchmark=SimpleNamespace(describe=dict))
    assert _document(described, described, scores)["best"] == best  # type: ignore[arg-type]


def test_compare_says_which_is_better_and_where(shell: Shell) -> None:
    shell("merge pool --subset kitti,indoor -o a.safetensors")
    shell("merge pool --subset driving,indoor -o b.safetensors")
    line = f"compare a.safetensors b.safetensors {PAIRS} --metric epe,d1"
    document = shell.json(f"{line} --maps maps")
    recipes = "--recipe a.safetensors --recipe b.safetensors"
    scored = shell.json(f"evaluate pool {PAIRS} {recipes} --metric epe,d1")["scores"]
    expected = {(row["network"].removesuffix(".safetensors"), row["metric"]): row["score"] for row in scored}
    for found in document["differences"]:
        ours = {name: expected[name, found["metric"]] for name in ("a", "b")}
        assert found["scores"] == pytest.approx(ours)
        assert found["difference"] == pytest.approx(ours["b"] - ours["a"])
        low, high = found["interval"]
        assert low <= found["difference"] <= high
        assert found["verdict"] in set(Judgement)
    shared = shell.json(f"{line} --engine processes --workers 2")["differences"]
    apart = shell.json(f"{line} --precision bfloat16")["differences"]
    for there, lower, full in zip(shared, apart, document["differences"], strict=True):
        # Another number of threads a worker moves disparities by some 1e-6 of their size.
        assert there["scores"] == pytest.approx(full["scores"], rel=1e-5)
        assert lower["scores"] == pytest.approx(full["scores"], rel=0.1)
    assert [one["scores"] for one in apart] != [one["scores"] for one in document["differences"]]
    text, _ = shell(line)
    assert f"epe: b is {document['differences'][0]['verdict']}" in text
    assert max(map(len, text.splitlines()[:4])) <= 80

    files = sorted(path.name for path in Path("maps").iterdir())
    assert len(files) == 5 * 6
    assert "pair0_better.png" in files
    left, right = Path("pairs/pair0/left.png"), Path("pairs/pair0/right.png")
    maps = {name: np.asarray(sfkit.load(f"{name}.safetensors")(left, right)) for name in ("a", "b")}
    truth = sfkit.open_benchmark("pairs", "pairs").pairs[0].load().disparity
    nearer = np.abs(maps["b"] - truth) - np.abs(maps["a"] - truth)
    painted = cv2.imread("maps/pair0_better.png")[..., ::-1].astype(int)
    assert painted.shape[:2] == truth.shape
    row, column = np.unravel_index(np.nanargmin(np.where(np.isfinite(nearer), nearer, np.nan)), truth.shape)
    middle, blue = (lookup(ERROR)[place].astype(int) for place in (128, 0))
    there = painted[row, column]
    assert np.abs(there - blue).sum() < np.abs(middle - blue).sum(), "blue where b is nearer by the most"
    _, said = shell(f"{line} --maps maps", code=2)
    assert "maps/pair0_a_disparity.png exists" in said


def test_compare_says_which_network_failed(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("kitti", "indoor"):
        shell(f"merge pool --subset {name},driving -o {name}.safetensors")
    monkeypatch.setattr(prediction_files, "predict", lambda *_: 1 / 0)
    _, said = shell(f"compare kitti.safetensors indoor.safetensors {PAIRS}", code=1)
    assert "error: kitti on pair0: the network failed (ZeroDivisionError: division by zero)" in said


def test_compare_refuses_before_any_work(shell: Shell) -> None:
    shell("merge pool --subset kitti,indoor -o a.safetensors")
    for line, words in (
        (f"compare a.safetensors a.safetensors {PAIRS}", "expected two networks"),
        (f"compare a.safetensors none.safetensors {PAIRS}", "none.safetensors: no such file"),
        (f"compare a.safetensors pool/a.safetensors {PAIRS}", "does not say its architecture"),
        (
            f"compare a.safetensors pool/b.safetensors --architecture anynet {PAIRS} --maps m --engine auto",
            "expected inline",
        ),
        ("compare a.safetensors pool/a.safetensors --architecture anynet -b pairs", "--root is missing"),
    ):
        _, said = shell(line, code=2)
        assert words in said


def test_merge_says_what_weights_mean_that_do_not_sum_to_1(shell: Shell) -> None:
    texts = {
        weight: shell(f"merge pool --weights kitti={weight},indoor={weight} -o {weight}.safetensors")[0]
        for weight in ("0.25", "0.5", "1")
    }
    assert "sum to 0.5, not to 1: the network lies 0.5 times as far from the base" in texts["0.25"]
    assert "beyond it; running statistics are never carried beyond" in texts["1"]
    assert "sum to" not in texts["0.5"]
    key = "feature_extraction.block0.0.0.weight"
    base = load_file("pool/base.safetensors")[key]
    half, one, two = (load_file(f"{weight}.safetensors")[key] - base for weight in texts)
    assert torch.allclose(half, 0.5 * one, atol=1e-6)
    assert torch.allclose(two, 2.0 * one, atol=1e-6)


@pytest.mark.parametrize(("minutes", "asked"), [(9.0, False), (11.0, True)])
def test_a_search_asks_where_it_takes_over_ten_minutes(
    minutes: float, asked: bool, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Keyboard(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sfkit.search.pipeline.cost", lambda *_: Estimate(10, 6.0 * minutes, 0, 6))
    monkeypatch.setattr("sys.stdin", Keyboard("n\n"))
    line = f"search pool {PAIRS} --population 4 --generations 1 --evaluations 4 -o run"
    _, said = shell(line, code=130 if asked else 0)
    assert ("Start? [Y/n]" in said) is asked
    assert Path("run/result.json").exists() is not asked


def test_open_copies_a_notebook_once_and_starts_lab_on_it(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(subprocess, "call", lambda command: started.append(command) or 0)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    document = shell.json("open quickstart")
    assert document == {"notebook": "notebooks/01_quickstart.ipynb", "kept": False}
    assert started[0][1:] == ["-P", "-m", "jupyterlab", "notebooks/01_quickstart.ipynb"]
    mine = Path("notebooks/01_quickstart.ipynb")
    mine.write_text("mine")
    assert shell.json("open 01_quickstart --no-lab")["kept"] is True
    assert mine.read_text() == "mine"
    assert len(started) == 1
    _, said = shell("open 01_quickstrat --no-lab", code=2)
    assert "01_quickstart" in said
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    _, said = shell("open quickstart", code=2)
    assert "pip install 'sfkit[jupyter]'" in said
