"""Searches in forked processes, to be killed, starved of disk or shown a wrong clock; what they leave."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch
from safetensors.torch import save_file
from tiny import write_pairs

TRIES = 5
PATIENCE = 600  # seconds; only a machine in trouble needs more for one evaluation
TIMING = ["cached", "seconds", "cpu_seconds"]  # what tells of this run, not of the search
WORDS = (
    *("search", "pool", "-b", "pairs", "-r", "pairs", "--metric", "epe", "--seed", "3", "--yes", "--json"),
    *("--population", "5", "--generations", "2", "--evaluations", "24", "--engine", "inline"),
)
FLAGS = ("--yes", "--json")  # options without a value
FILES = ("result.json", "recipe.json", "merged.safetensors")

Row = tuple[str, str, str | None, float, int]
"""An evaluation as it lies in the store: key, errors, failure, time of writing, attempts."""


def write_pool(folder: Path, sources: int = 5) -> None:
    """A pool of two-number networks, see ``faults_network.py``; sources are called a, b, c, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ['name = "brief"', 'architecture = "brief"', "[base]", 'file = "base.safetensors"']
    rng = torch.Generator().manual_seed(3)
    for name in ("base", *(chr(ord("a") + n) for n in range(sources))):
        level, slope = torch.rand(2, generator=rng)
        state = {"level": 3 + 4 * level[None], "slope": slope[None]}
        save_file(state, folder / f"{name}.safetensors")
        lines += [] if name == "base" else [f"[sources.{name}]", f'file = "{name}.safetensors"']
    (folder / "pool.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def without(words: Sequence[str], others: Sequence[str]) -> list[str]:
    """The words but for options that are among the others: a command takes each once."""
    kept, rest = [], iter(words)
    for word in rest:
        if not (word.startswith("-") and word in others):
            kept.append(word)
        elif word not in FLAGS:
            next(rest)
    return kept


class Searches:
    """A folder with a pool and pairs, and a process that forks searches in it."""

    def __init__(self, world: Path) -> None:
        write_pool(world / "pool")
        write_pairs(world / "pairs", 1)
        self.world = world
        self._server = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("faults_server.py"))],
            cwd=world,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.ask(warm=[*WORDS, "-o", "warm"])

    def close(self) -> None:
        """End the process that forks."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        with self._server.stdin, self._server.stdout:
            pass
        assert self._server.wait(PATIENCE) == 0

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and hear the answer; see ``faults_server.py``."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        answer: dict[str, Any] = json.loads(self._server.stdout.readline())
        return answer


class Run:
    """One search, its folder and its store.

    Args:
        searches: where it runs.
        name: of its folder.
        store: of another run, to share; its own otherwise.
    """

    def __init__(self, searches: Searches, name: str, store: Path | None = None) -> None:
        self._searches, self.name, self.folder = searches, name, searches.world / name
        self.store = store or self.folder / "evaluations.sqlite"

    def start(self, *more: str, **limits: Any) -> int:
        """Start the search; returns its process number."""
        words = [*without(WORDS, more), *more, "-o", self.name, "--store", str(self.store)]
        return int(self._searches.ask(words=words, name=self.name, **limits)["pid"])

    def wait(self, pid: int) -> int:
        """Wait for its end; returns its exit code."""
        return int(self._searches.ask(wait=pid)["code"])

    def kill_at(
        self,
        least: int,
        *more: str,
        below: int | None = None,
        pause: float = 0.0,
        look: Callable[[int], object] = lambda _: None,
        **start: Any,
    ) -> None:
        """Start the search and kill -9 it once its store holds so many evaluations.

        On a busy machine the kill may come too late: then it is done again, from where it was before.

        Args:
            least: evaluations in the store.
            more: options of the search.
            below: too late is also a store with so many.
            pause: seconds before the kill.
            look: called with the process's number, before the pause.
            start: as for :meth:`start`.
        """
        before = self.folder.with_name(f"{self.name}-before")
        if self.folder.exists():
            shutil.copytree(self.folder, before)
        for _ in range(TRIES):
            pid = self.start(*more, **start)
            self.await_rows(least, pid)
            look(pid)
            time.sleep(pause)
            os.kill(pid, signal.SIGKILL)
            code = self.wait(pid)
            assert code in (0, -signal.SIGKILL), self.said
            if code and (below is None or self.count() < below):
                shutil.rmtree(before, ignore_errors=True)
                return
            shutil.rmtree(self.folder)
            if before.exists():
                shutil.copytree(before, self.folder)
        pytest.fail(f"the kill came too late {TRIES} times")

    def await_store(self, pid: int) -> None:
        """Wait until the store is there, or the process has ended."""
        while not self.store.exists() and not ended(pid):
            time.sleep(0.0005)

    def finish(self, pid: int | None = None, *more: str) -> dict[str, Any]:
        """Let it run to its end; what it printed."""
        code = self.wait(self.start(*more) if pid is None else pid)
        assert code == 0, self.said
        document: dict[str, Any] = json.loads((self._searches.world / f"{self.name}.out").read_text())
        return document

    @property
    def said(self) -> str:
        """What it wrote on standard error."""
        return (self._searches.world / f"{self.name}.err").read_text()

    def count(self) -> int:
        """How many evaluations the store holds; 0 before it is there."""
        if not self.store.exists():
            return 0
        with closing(sqlite3.connect(self.store, timeout=60)) as db:
            tables = db.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'evaluations'").fetchone()[0]
            return int(db.execute("SELECT COUNT(*) FROM evaluations").fetchone()[0]) if tables else 0

    def rows(self) -> list[Row]:
        """Every evaluation, in the order they were written."""
        with closing(sqlite3.connect(self.store)) as db:
            assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
            query = "SELECT key, errors, failure, written, attempts FROM evaluations ORDER BY number"
            return db.execute(query).fetchall()

    def await_rows(self, least: int, pid: int) -> None:
        """Wait until the store holds so many evaluations, or the process has ended."""
        deadline = time.monotonic() + PATIENCE
        while self.count() < least and not ended(pid):
            assert time.monotonic() < deadline, f"{self.count()} of {least} evaluations after {PATIENCE} s"
            time.sleep(0.002)

    def tables(self) -> list[pd.DataFrame]:
        """Both stages' candidates as text, without what tells of the run."""
        files = [self.folder / f"{stage}.csv" for stage in ("stage1", "stage2")]
        return [pd.read_csv(file, dtype=str).drop(columns=TIMING) for file in files]


def computed(document: dict[str, Any]) -> int:
    """What a search computed, its verdict included."""
    return int(document["evaluations"]["computed"] + document["verdict_evaluations"]["computed"])


def ended(pid: int) -> bool:
    """True once a process has ended, waited for or not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    return state in "ZX"


def content(rows: list[Row]) -> list[tuple[Any, ...]]:
    """Keys, errors, failures and attempts, without the clock."""
    return [(key, errors, failure, attempts) for key, errors, failure, _, attempts in rows]


def assert_same_end(run: Run, reference: Run) -> None:
    """Both searches left the same files and tables, and each evaluation once."""
    for file in FILES:
        assert (run.folder / file).read_bytes() == (reference.folder / file).read_bytes(), file
    for one, other in zip(run.tables(), reference.tables(), strict=True):
        pd.testing.assert_frame_equal(one, other)
    assert sorted(content(run.rows())) == sorted(content(reference.rows()))
    assert all(attempts == 1 for *_, attempts in run.rows()), "nothing was computed twice"
