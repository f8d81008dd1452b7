"""Interpreters that sfkit starts run no code from the working folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from sfkit.bank import demo
from sfkit.evaluation.engines import spawned
from sfkit.evaluation.engines.spawned import Spawned
from sfkit.reports.kernel import ThisInterpreter

HOSTILE = "import pathlib\npathlib.Path('ran').touch()\nraise SystemExit(3)\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("json.py", "signal.py", "multiprocessing.py", "runpy.py"):
        (tmp_path / name).write_text(HOSTILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_worker_starts_from_no_code_of_the_working_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        spawned,
        "_BOOT",
        spawned._BOOT.partition("from sfkit")[0] + "from importlib.util import find_spec; "
        "print(json.__file__, find_spec('sfkit').origin, file=sys.stderr)",
    )
    heard = folder / "heard.txt"
    plain = subprocess.Popen

    def listening(*arguments: Any, **keywords: Any) -> subprocess.Popen[bytes]:
        with heard.open("wb") as stream:
            return plain(*arguments, stderr=stream, **keywords)

    monkeypatch.setattr(spawned.subprocess, "Popen", listening)
    worker = Spawned(1, folder)
    assert worker.ended() == "exited with code 0", heard.read_text()
    worker.release()
    assert not (folder / "ran").exists()
    said = heard.read_text()
    assert str(Path(os.__file__).parent / "json") in said
    assert str(Path(demo.__file__).parents[1]) in said, "sfkit is the parent's"


def test_a_report_kernel_starts_from_no_code_of_the_working_folder(folder: Path) -> None:
    command = ThisInterpreter().kernel_spec.argv
    start = command[: command.index("-m") + 1]
    done = subprocess.run([*start, "json.tool", "--help"], capture_output=True, check=False, cwd=folder)
    assert done.returncode == 0
    assert not (folder / "ran").exists()


def test_the_second_process_of_the_demo_does_so_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "_score_members", abs)
    seen: dict[str, str | None] = {}

    class Pool:
        def __init__(self, *_: object, **__: object) -> None: ...

        def submit(self, *_: object) -> None:
            seen["safe"] = os.environ.get("PYTHONSAFEPATH")

        def shutdown(self, **_: object) -> None: ...

    monkeypatch.setattr(demo, "ProcessPoolExecutor", Pool)
    monkeypatch.setattr(demo, "_unseen", lambda: ("one",))
    former = os.environ.get("PYTHONSAFEPATH")
    with demo._scored_meanwhile(folder, demo.HERE):
        assert os.environ.get("PYTHONSAFEPATH") == former
    assert seen == {"safe": "1"}
    done = subprocess.run(
        [sys.executable, "-c", "import json"], env={**os.environ, "PYTHONSAFEPATH": "1"}, check=False
    )
    assert done.returncode == 0
