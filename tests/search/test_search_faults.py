"""What happens around a search: a disk that fills, a clock that jumps, company on its store, a reader."""

from __future__ import annotations

import math
import os
import sqlite3
from contextlib import closing
from datetime import datetime

import pytest
from faults_world import Run, Searches, assert_same_end, computed, content, ended

from sfkit.evaluation.store import EvaluationStore
from sfkit.search.following import FollowedJournal
from sfkit.search.journal import last_run, read_journal
from sfkit.search.progress import Phase, watched_progress
from sfkit.search.runs import State, find_runs, read_run

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux")


def test_a_search_on_a_full_disk_says_so_and_goes_on_when_there_is_room(
    searches: Searches, whole: Run
) -> None:
    """Files may grow to so many KiB each, the first of which is the store's log."""
    expected, full = whole.rows(), 0
    for room in (60, 110, 170, 250):
        run = Run(searches, f"full{room}")
        assert run.wait(run.start(file_limit=room << 10)) == 2
        error = run.said.splitlines()[-1]
        assert error.startswith(f"error: {run.store}: cannot be read or written (")
        assert error.endswith("make room and start again")
        stored = run.rows()
        assert full < len(stored) < len(expected), "the more room, the more is stored"
        full = len(stored)
        assert content(stored) == content(expected[:full])
        assert computed(run.finish()) == len(expected) - full
        assert run.rows()[:full] == stored
        assert_same_end(run, whole)


def test_a_clock_that_jumps_changes_nothing(searches: Searches, whole: Run) -> None:
    """Every look at the wall clock is hours off, to either side, and a restart begins years earlier."""
    run = Run(searches, "clock")
    hour, year = 3600.0, 365 * 86400.0
    run.kill_at(8, clock=[0, -2 * hour, 5 * hour, -9 * hour])
    run.finish(run.start(clock=[-3 * year, -3 * year - hour]))
    written = [row[3] for row in run.rows()]
    assert written != sorted(written), "it did jump"
    assert max(written) - min(written) > 2 * year
    assert_same_end(run, whole)

    stages = read_run(run.folder).stages
    assert [stage.state for stage in stages] == [State.FINISHED, State.FINISHED]
    assert [stage.score for stage in stages] == [stage.score for stage in read_run(whole.folder).stages]
    times = [datetime.fromisoformat(record["time"]) for record in read_journal(run.folder / "journal.jsonl")]
    assert times != sorted(times)
    progress = watched_progress(read_journal(run.folder / "journal.jsonl"), "routing")
    assert progress.phase is Phase.FINISHED


@pytest.mark.parametrize("seeds", [("3", "3"), ("3", "8")], ids=["same", "other"])
def test_two_searches_that_make_and_share_one_store_end_as_each_would_alone(
    searches: Searches, whole: Run, seeds: tuple[str, str]
) -> None:
    name = "+".join(seeds)
    alone = {"3": whole}
    if seeds[1] not in alone:
        alone[seeds[1]] = Run(searches, f"alone{seeds[1]}")
        alone[seeds[1]].finish(None, "--seed", seeds[1])
    first = Run(searches, f"first{name}")
    first.folder.mkdir()
    second = Run(searches, f"second{name}", store=first.store)
    pids = [run.start("--seed", seed) for run, seed in zip((first, second), seeds, strict=True)]
    for run, seed, pid in zip((first, second), seeds, pids, strict=True):
        run.finish(pid)
        for file in ("result.json", "recipe.json", "merged.safetensors"):
            assert (run.folder / file).read_bytes() == (alone[seed].folder / file).read_bytes(), file
        assert [t.to_dict() for t in run.tables()] == [t.to_dict() for t in alone[seed].tables()]
    stored = {row[0]: row[1:3] for row in first.rows()}
    needed = {row[0]: row[1:3] for run in alone.values() for row in run.rows()}
    assert stored == needed, "each evaluation once, and none that neither asked for"
    assert len(first.rows()) == len(stored)


def test_readers_follow_a_running_search_and_do_not_disturb_it(searches: Searches, whole: Run) -> None:
    expected = content(whole.rows())
    run = Run(searches, "followed")
    run.folder.mkdir()
    pid = run.start()
    followed = FollowedJournal(run.folder)
    sizes, generations = set(), set()
    while not ended(pid):
        if run.count():
            with EvaluationStore(run.store) as store:
                seen = [(e.key, e.failure) for e in store]
            assert seen == [(key, failure) for key, _, failure, _ in expected[: len(seen)]]
            sizes.add(len(seen))
        for kind in followed.searches():
            progress = watched_progress(followed.records(), kind)
            assert progress.best is None or math.isfinite(progress.best.score)
            generations.add((kind, progress.generation))
        assert len(find_runs(run.folder)) <= 1
    run.finish(pid)
    assert len(sizes) > 3, "it was read while it ran"
    assert len(generations) > 1
    assert_same_end(run, whole)
    last = last_run(followed.records(), "routing")
    assert last[-1]["event"] == "end"


def test_a_damaged_write_ahead_log_costs_evaluations_but_no_result(searches: Searches, whole: Run) -> None:
    """After a kill the last evaluations lie in the log; SQLite drops what does not match its checksums."""
    expected = whole.rows()
    run = Run(searches, "log")
    run.kill_at(len(expected) // 2)
    log = run.store.with_name(run.store.name + "-wal")
    data = bytearray(log.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 5000] = os.urandom(5000)
    log.write_bytes(data)
    run.store.with_name(run.store.name + "-shm").unlink()
    with closing(sqlite3.connect(run.store)) as db:
        left = db.execute("SELECT COUNT(*) FROM evaluations").fetchone()[0]
    assert 0 < left < len(expected) // 2
    assert computed(run.finish()) == len(expected) - left
    assert_same_end(run, whole)
