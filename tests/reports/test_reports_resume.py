"""A report killed in the middle of a search goes on where it was: nothing is computed twice."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from sfkit import EvaluationStore

SMALL = {
    "benchmark_pairs": 1,
    "report_on": [{"name": "bank:indoor-rooms", "pairs": 1}],
    "population": 6,
    "generations": 2,
    "evaluations": 12,
}
WAIT = 900  # seconds until the first evaluations are there, on however busy a machine


def started(out: Path) -> subprocess.Popen[bytes]:
    words = [word for name, value in SMALL.items() for word in ("-p", name, json.dumps(value))]
    command = [sys.executable, "-m", "sfkit", "report", "07_ablations", *words, "-p", "seeds", "1"]
    with (out / "progress").open("ab") as log:
        return subprocess.Popen(
            [*command, "-p", "out", str(out), "-o", str(out / "page.html")],
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def evaluations(out: Path) -> dict[str, float]:
    """Key -> seconds of everything in the store, which tell one computation from another."""
    with EvaluationStore(out / "evaluations.sqlite") as store:
        return {held.key: held.seconds for held in store}


@pytest.mark.slow
def test_a_killed_report_resumes_from_the_store(tmp_path: Path) -> None:
    first = started(tmp_path)
    deadline = time.monotonic() + WAIT
    while not ((tmp_path / "evaluations.sqlite").exists() and len(evaluations(tmp_path)) >= 5):
        assert first.poll() is None, (tmp_path / "progress").read_text()
        assert time.monotonic() < deadline
        time.sleep(0.2)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    before = evaluations(tmp_path)
    assert not (tmp_path / "page.html").exists()

    assert started(tmp_path).wait() == 0, (tmp_path / "progress").read_text()
    after = evaluations(tmp_path)
    assert len(after) > len(before)
    assert {key: after[key] for key in before} == before
    with EvaluationStore(tmp_path / "evaluations.sqlite") as store:
        assert {store.attempts(key) for key in after} == {1}
    said = (tmp_path / "progress").read_text()
    assert len(re.findall(r"cell 1 of \d+: pool = ", said)) == 2, "progress is told cell by cell"
    assert len(pd.read_csv(tmp_path / "tables" / "guides.csv")) == 2
