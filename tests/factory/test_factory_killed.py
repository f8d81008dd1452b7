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

import sfkit
from sfkit.factory import Item, read_factory, run, status, train_missing, train_one
from sfkit.factory.standing import INTERRUPTED, MISSING, RUNNING
from sfkit.training.places import training_folder

LONG = 100_000  # steps, at most a few hundred of which are waited for


def test_a_training_runs_as_long_as_its_process_lives(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene")
    path.write_text(path.read_text().replace("epochs = 2", f"epochs = {LONG}\nmax_steps = {LONG}"))
    factory = read_factory(path)

    def stands() -> tuple[Item, ...]:
        return status(read_factory(path))

    command = [sys.executable, "-m", "sfkit", "factory", "train", str(path), "haze"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        try:
            while child.poll() is None and stands()[0].done < 3:
                time.sleep(0.05)
            haze, other = stands()
            assert (haze.state, haze.steps, other.state) == (RUNNING, LONG, MISSING)
            assert haze.seconds is not None
            assert haze.left == pytest.approx(haze.seconds * (LONG - haze.done) / LONG)
            assert other.left == pytest.approx(haze.seconds), "as long, and trained alike"
            with pytest.raises(sfkit.InputError, match="another process is training haze, wait for its end"):
                train_missing(factory)
            with pytest.raises(sfkit.InputError, match="another process is training it, wait for its end"):
                train_one(factory, "haze")
            assert child.poll() is None, "neither disturbed the other"
        finally:
            child.kill()
    haze = stands()[0]
    (saved,) = {int(f.stem[6:]) for f in training_folder(haze.file).glob("state-*.pt")} - {haze.done - 1}
    assert (haze.state, haze.done) == (INTERRUPTED, saved)


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
