"""Bad input: exit code 2, one sentence that names file or argument and cause; nothing written or run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cli_cases import CASES, Case
from cli_world import make_world

from sfkit import merging
from sfkit.cli import main
from sfkit.evaluation.engines.worker import Worker
from sfkit.merging.live import LiveModel

SECOND_SENTENCE = re.compile(r"[.!?]\s+[A-Z]")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_world(tmp_path_factory.mktemp("world"))
    (folder / "folder.safetensors").mkdir()
    return folder


def contents(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of writing of every path below a folder."""
    stats = {path: path.lstat() for path in sorted(folder.rglob("*"))}
    return {str(path): (stat.st_size, stat.st_mtime_ns) for path, stat in stats.items()}


def refusal(errors: str) -> str:
    """The one sentence on standard error, beside warnings."""
    lines = [line for line in errors.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1, errors
    assert lines[0].startswith("error: ")
    sentence = lines[0].removeprefix("error: ")
    assert not SECOND_SENTENCE.search(sentence), sentence
    return sentence


def no_network(*_: object, **__: object) -> None:
    raise AssertionError("a network ran although the input is bad")


def test_there_are_enough_cases() -> None:
    assert len(CASES) >= 30
    assert len({case.id for case in CASES}) == len(CASES) == len({case.line for case in CASES})


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_refused(
    case: Case, world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(world)
    monkeypatch.setattr(Worker, "run", no_network)
    monkeypatch.setattr(LiveModel, "__init__", no_network)
    before = contents(world)
    with pytest.raises(SystemExit) as ended:
        main(case.line.split())
    out, errors = capsys.readouterr()
    assert ended.value.code == 2
    assert out == ""
    sentence = refusal(errors)
    for word in case.words:
        assert word in sentence
    assert contents(world) == before


BEFORE_THE_POOL = (
    "no-root", "metric", "protocol", "benchmark", "evaluate-nothing", "evaluate-empty", "evaluate-not-json",
    "evaluate-device", "evaluate-out-ending", "evaluate-out-exists", "evaluate-store-garbage",
    "evaluate-store-folder", "baselines-name", "baselines-oracle", "baselines-population",
    "baselines-out-exists", "search-population", "search-generations", "search-start-alone", "search-out",
    "search-kept", "search-store", "merge-nothing", "merge-two", "merge-negative", "merge-exists",
    "merge-ending", "merge-folder", "merge-under-file",
)  # fmt: skip


@pytest.mark.parametrize("name", BEFORE_THE_POOL)
def test_arguments_and_outputs_are_checked_before_the_pool_is_opened(
    name: str, world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def opened(path: object) -> None:
        raise AssertionError(f"{path} was opened although other input is bad")

    monkeypatch.chdir(world)
    monkeypatch.setattr(merging, "open_pool", opened)
    with pytest.raises(SystemExit, match=r"^2$"):
        main(next(case for case in CASES if case.id == name).line.split())
    refusal(capsys.readouterr().err)


@pytest.mark.parametrize("name", ["pool-nan", "pairs-unequal"])
def test_a_process_of_its_own_says_the_same(name: str, world: Path) -> None:
    case = next(case for case in CASES if case.id == name)
    before = contents(world)
    ended = subprocess.run(
        [sys.executable, "-c", "from sfkit.cli import main; main()", *case.line.split()],
        cwd=world,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert all(word in refusal(ended.stderr) for word in case.words)
    assert contents(world) == before


@pytest.mark.parametrize(
    "line",
    [
        "merge pool.toml --recipe a.json --recipe b.json -o m.safetensors",
        "search pool.toml -b pairs -r pairs --seed 1 --seed 2",
        "merge pool.toml -s a -o m.safetensors --subset b",
        "data check pairs --root a --root b",
    ],
)
def test_an_option_said_twice_is_refused(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The last of two used to win."""
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    assert "found it 2 times, expected it once" in capsys.readouterr().err
