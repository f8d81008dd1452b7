"""``--engine`` and ``--workers``: refused at the door, said on standard error, without effect on scores."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import tiny
import torch

from sfkit.cli import main

PAIRS = "-b pairs -r pairs"


@pytest.fixture(autouse=True)
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny.write_pool(tmp_path / "pool")
    tiny.write_pairs(tmp_path / "pairs", 2)
    monkeypatch.chdir(tmp_path)


def run(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command line."""
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    return int(ended.value.code or 0), *capsys.readouterr()


@pytest.mark.parametrize("command", ["evaluate pool --uniform", "search pool"])
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--engine dask", "unknown engine 'dask', expected one of: auto, inline, processes, ray"),
        ("--engine processes --workers 0", "workers: found 0, expected at least 1"),
        ("--engine inline --workers 2", "workers: found 2, engine 'inline' has one"),
    ],
)
def test_an_engine_that_cannot_be_had_is_refused(
    command: str, options: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, errors = run(f"{command} {PAIRS} {options}", capsys)
    assert (code, out) == (2, "")
    assert sentence in errors


def scores(document: dict[str, Any]) -> list[tuple[str, float]]:
    return [(row["network"], row["score"]) for row in document["scores"]]


def test_worker_processes_print_what_the_inline_engine_prints(capsys: pytest.CaptureFixture[str]) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        line = f"evaluate pool {PAIRS} --members --uniform --json"
        code, out, errors = run(line, capsys)
        assert code == 0
        assert (
            "engine: auto picked inline: one evaluation at a time on cpu, 1 thread (the CPU is one device"
            in errors
        )
        code, shared, errors = run(f"{line} --engine processes --workers 1", capsys)
        assert code == 0
        assert "engine: processes: 1 worker on cpu, 1 thread each" in errors
    finally:
        torch.set_num_threads(before)
    assert scores(json.loads(shared)) == scores(json.loads(out))
    assert len(json.loads(out)["scores"]) == 5


def test_a_search_says_its_engine(capsys: pytest.CaptureFixture[str]) -> None:
    line = f"search pool {PAIRS} --population 3 --generations 1 --evaluations 0 --engine inline -o found"
    code, _, errors = run(line, capsys)
    assert code == 0
    assert "engine: inline: one evaluation at a time on cpu, " in errors
