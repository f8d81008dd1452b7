"""Kill -9 of searches whose workers live elsewhere: what they stored is kept, and any engine goes on from it.

A search is killed on its way (on Ray, which starts slowly, once; by ``make soak`` many times), with the
same store each time; after each kill another process ends it from a copy of that store, as if nothing had
happened.
"""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
from contextlib import closing

import pytest
from clusters import ENVIRONMENT, LEAVES_TO_THE_COLLECTOR, Process, assert_all_end, descendants, two_nodes
from faults_world import Run, Searches, assert_same_end, computed, content

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux"),
    *LEAVES_TO_THE_COLLECTOR,
]
KILLS = int(os.environ.get("SFKIT_ENGINE_KILLS", "2"))
SEED = int(os.environ.get("SFKIT_KILLS_SEED", "1"))


def test_processes(searches: Searches, whole: Run) -> None:
    killed_on_the_way(searches, whole, "processes", {})


def test_ray(searches: Searches, whole: Run) -> None:
    """The cluster outlives its drivers, and frees their CPUs for the next; it leaves no process itself."""
    with two_nodes() as cluster:
        killed_on_the_way(searches, whole, "ray", {**ENVIRONMENT, "RAY_ADDRESS": cluster.address})


def test_a_killed_search_takes_the_ray_it_started_along(searches: Searches, whole: Run) -> None:
    pytest.importorskip("ray", reason="Ray is not installed: pip install sfkit[ray]")
    # Ray's agents look for their cluster for a minute unless told otherwise.
    environment = {**ENVIRONMENT, "RAY_gcs_rpc_server_reconnect_timeout_s": "3"}
    run = Run(searches, "its own ray")
    started: list[Process] = []
    words = ("--engine", "ray", "--workers", "2")
    run.kill_at(
        1,
        *words,
        below=len(whole.rows()),
        look=lambda pid: started.extend(descendants(pid)),
        environment=environment,
    )
    assert len(started) > 3, "the scheduler, its head, and two workers"
    assert_all_end(started)
    stored = run.count()
    assert stored > 0
    assert computed(run.finish()) == len(whole.rows()) - stored
    assert_same_end(run, whole)


def killed_on_the_way(searches: Searches, whole: Run, engine: str, environment: dict[str, str]) -> None:
    """Kill, end a copy, go on; every kill falls between the first evaluation and the last."""
    rng, total = random.Random(f"{SEED}/{engine}"), len(whole.rows())
    run, kept = Run(searches, engine), []
    for number in range(KILLS if engine == "processes" else max(1, KILLS // 2)):
        if len(kept) > total - 4:  # no room for another kill: from the start again
            shutil.rmtree(run.folder)
            kept = []
        room = (total - 3 - len(kept)) // 5
        least, pause = len(kept) + rng.randrange(1, max(room, 2)), rng.uniform(0, 0.003)
        words = ("--engine", engine, "--workers", "2")
        run.kill_at(least, *words, below=total, pause=pause, environment=environment)
        stored = run.rows()
        assert len(kept) < len(stored) < total
        assert stored[: len(kept)] == kept
        assert set(content(stored)) < set(content(whole.rows())), "the scores of one process"
        kept = stored

        copy = Run(searches, f"{engine}-{number}")
        copy.folder.mkdir()
        with closing(sqlite3.connect(run.store)) as source, closing(sqlite3.connect(copy.store)) as target:
            source.backup(target)
        assert computed(copy.finish()) == total - len(stored)
        assert copy.rows()[: len(stored)] == stored
        assert_same_end(copy, whole)
