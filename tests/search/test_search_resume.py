"""A search killed in the middle of either stage ends as if it had never been, and repeats nothing."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from tiny import write_pairs, write_pool

from sfkit.cli import main

PATIENCE = 300  # seconds; only a machine in trouble needs more for one evaluation
TRIES = 5
TIMING = ["cached", "seconds", "cpu_seconds"]  # what tells of this run, not of the search
LINE = [
    *(
        "search",
        "pool",
        "-b",
        "pairs",
        "-r",
        "pairs",
        "--metric",
        "bad-1.0",
        "--seed",
        "3",
        "--yes",
        "--json",
    ),
    *("--population", "6", "--generations", "3", "--evaluations", "24", "-o"),
]


class Run:
    """One search in a folder of its own, in processes of its own."""

    def __init__(self, world: Path, name: str) -> None:
        self.world, self.name, self.folder = world, name, world / name
        self.store = self.folder / "evaluations.sqlite"

    def start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", "from sfkit.cli import main; main()", *LINE, self.name],
            cwd=self.world,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def finish(self, process: subprocess.Popen[str] | None = None) -> dict[str, Any]:
        """Let a search run to its end; what it printed."""
        process = process or self.start()
        out, _ = process.communicate()
        assert process.returncode == 0
        document: dict[str, Any] = json.loads(out)
        return document

    def kill_at(self, rows: int) -> None:
        """Start the search and kill -9 it as soon as its store holds so many evaluations.

        On a busy machine the kill may come after its end: then it is done again, from where it was before.
        """
        before = self.world / f"{self.name}-before"
        if self.folder.exists():
            shutil.copytree(self.folder, before)
        for _ in range(TRIES):
            process = self.start()
            try:
                deadline = time.monotonic() + PATIENCE
                while self.rows() < rows and process.poll() is None and time.monotonic() < deadline:
                    time.sleep(0.002)
            finally:
                process.kill()
                process.communicate()
            if process.returncode == -9:
                break
            shutil.rmtree(self.folder)
            if before.exists():
                shutil.copytree(before, self.folder)
        else:
            pytest.fail(f"it ended by itself {TRIES} times")
        shutil.rmtree(before, ignore_errors=True)

    def rows(self) -> int:
        """How many evaluations the store holds; 0 before it is there."""
        if not self.store.exists():
            return 0
        with closing(sqlite3.connect(self.store, timeout=60)) as db:
            tables = db.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'evaluations'").fetchone()[0]
            return int(db.execute("SELECT COUNT(*) FROM evaluations").fetchone()[0]) if tables else 0

    def evaluations(self) -> list[tuple[Any, ...]]:
        """Key, errors and time of writing of every evaluation, in the order they were written."""
        with closing(sqlite3.connect(self.store)) as db:
            return db.execute("SELECT key, errors, written FROM evaluations ORDER BY number").fetchall()

    def table(self, stage: str) -> pd.DataFrame:
        """A stage's candidates as text, without what tells of the run."""
        return pd.read_csv(self.folder / f"{stage}.csv", dtype=str).drop(columns=TIMING)


def computed(document: dict[str, Any]) -> int:
    """What a search computed, its verdict included."""
    return int(document["evaluations"]["computed"] + document["verdict_evaluations"]["computed"])


@pytest.fixture
def world(tmp_path: Path) -> Path:
    write_pool(tmp_path / "pool", 5)
    write_pairs(tmp_path / "pairs", 2, size=(64, 160))
    return tmp_path


def test_a_killed_search_ends_bit_identically_and_evaluates_nothing_twice(
    world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, killed = Run(world, "whole"), Run(world, "killed")
    reference = whole.finish()
    total = whole.rows()
    assert computed(reference) == total
    judged = reference["verdict_evaluations"]["computed"]
    assert judged > 0, "base is no candidate of either stage"
    stage1 = len({key for key, *_ in whole.evaluations()} & set(whole.table("stage1")["key"]))
    assert 6 < stage1 < total - judged - 8, "both stages have a middle"

    killed.kill_at(4)
    first = killed.evaluations()
    assert 0 < len(first) < stage1, "in the middle of Stage 1"
    assert not (killed.folder / "stage1.csv").exists()

    killed.kill_at(stage1 + 5)
    second = killed.evaluations()
    assert stage1 < len(second) < total - judged, "in the middle of Stage 2"
    assert second[: len(first)] == first
    assert (killed.folder / "stage1.csv").exists()
    assert not (killed.folder / "stage2.csv").exists()

    resumed = killed.finish()
    assert resumed["evaluations"]["computed"] == total - judged - len(second), "no search evaluation again"
    assert resumed["verdict_evaluations"]["computed"] == judged
    assert resumed["evaluations"]["failed"] == 0
    assert killed.rows() == total
    assert killed.evaluations()[: len(second)] == second
    assert [row[:2] for row in killed.evaluations()] == [row[:2] for row in whole.evaluations()]
    for file in ("result.json", "recipe.json", "merged.safetensors"):
        assert (killed.folder / file).read_bytes() == (whole.folder / file).read_bytes(), file
    for stage in ("stage1", "stage2"):
        pd.testing.assert_frame_equal(killed.table(stage), whole.table(stage))

    monkeypatch.chdir(world)
    with pytest.raises(SystemExit, match=r"^0$"):
        main([*LINE, killed.name])
    again = json.loads(capsys.readouterr().out)
    assert computed(again) == 0
    assert again["score"] == reference["score"]
    assert killed.rows() == total


def test_two_searches_share_one_store(
    world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What another search scored, with another seed and in another folder, is not computed again."""
    monkeypatch.chdir(world)
    line = ["search", "pool", "-b", "pairs", "-r", "pairs", "--population", "4", "--generations", "1"]
    counts = []
    for seed in ("1", "2", "1"):
        with pytest.raises(SystemExit, match=r"^0$"):
            main(
                [
                    *line,
                    "--evaluations",
                    "0",
                    "--seed",
                    seed,
                    "--store",
                    "s.sqlite",
                    "-o",
                    f"r{seed}",
                    "--json",
                ]
            )
        counts.append(json.loads(capsys.readouterr().out))
    with closing(sqlite3.connect(world / "s.sqlite")) as db:
        distinct = db.execute("SELECT COUNT(DISTINCT key) FROM evaluations").fetchone()[0]
    assert computed(counts[0]) + computed(counts[1]) == distinct
    assert counts[1]["evaluations"]["cached"] > 0
    assert computed(counts[2]) == 0
    assert counts[1]["verdict_evaluations"]["computed"] == 0, "a pool's own networks are judged once"
