"""A factory that is killed at random moments goes on where it was, and ends with the same files."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from factory_files import write

from sfkit.factory import read_factory, run, status


@pytest.mark.slow
def test_kill_9_at_random_moments_ends_with_the_same_files(tmp_path: Path) -> None:
    for name in ("whole", "killed"):
        (tmp_path / name).mkdir()
    whole = run(read_factory(write(tmp_path / "whole", "haze", "far-scene")))
    path = write(tmp_path / "killed", "haze", "far-scene")
    command = [sys.executable, "-m", "sfkit", "factory", "run", str(path)]
    rng = np.random.default_rng(0)
    marks = ("sources", "pool.toml", "search/stage1.csv", "scores.json")
    for mark in marks:
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
            # From a moment that comes in its turn, however slow the machine, a random while further.
            while child.poll() is None and not (tmp_path / "killed" / mark).exists():
                time.sleep(0.02)
            try:
                child.wait(timeout=float(rng.uniform(0, 1.0)))
            except subprocess.TimeoutExpired:
                child.send_signal(signal.SIGKILL)
    made = run(read_factory(path))
    for one, two in zip(status(read_factory(tmp_path / "whole" / "factory.toml")), made.items, strict=True):
        assert one.file.name == two.file.name
        assert one.file.read_bytes() == two.file.read_bytes()
    assert made.scores == whole.scores
    assert json.loads((tmp_path / "killed/scores.json").read_text()) == made.scores
    assert made.found.merged.read_bytes() == whole.found.merged.read_bytes()
