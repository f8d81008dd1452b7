"""kill -9 at many random moments: each search goes on and ends as if nothing had happened.

``make soak`` kills more often: SFKIT_KILLS says how often, SFKIT_KILLS_SEED which moments.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import time

import pytest
from faults_world import Run, Searches, assert_same_end, computed, content

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux")

KILLS = int(os.environ.get("SFKIT_KILLS", "50"))
SEED = int(os.environ.get("SFKIT_KILLS_SEED", "1"))
SHARES = 10  # tests the moments are shared out to, so that a failure names few of them


@pytest.mark.parametrize("share", range(SHARES))
def test_a_search_killed_at_a_random_moment_ends_bit_identically(
    searches: Searches, whole: Run, share: int
) -> None:
    rng = random.Random(f"{SEED}/{share}")
    total = len(whole.rows())
    killed = tries = 0
    while killed < KILLS // SHARES + (share < KILLS % SHARES):
        tries += 1
        assert tries < 3 * KILLS, "the kill comes too late again and again"
        run = Run(searches, f"killed{share}-{tries}")
        stored = kill_between(run, rng, total)
        if stored >= total:  # it had finished evaluating before the kill came
            continue
        killed += 1
        assert 0 < stored < total
        kept = run.rows()
        assert len(kept) == stored
        assert content(kept) == content(whole.rows()[:stored]), "written in order, and whole"
        assert not (run.folder / "result.json").exists()

        resumed = run.finish()
        assert computed(resumed) == total - stored
        assert run.rows()[:stored] == kept, "what was stored is not touched"
        assert_same_end(run, whole)
        shutil.rmtree(run.folder)


def kill_between(run: Run, rng: random.Random, total: int) -> int:
    """Kill a search somewhere between its first and its last evaluation; returns how many it stored."""
    pid = run.start()
    run.await_rows(rng.randrange(1, total - 1), pid)
    time.sleep(rng.uniform(0, 0.01))  # about as long as an evaluation takes
    os.kill(pid, signal.SIGKILL)
    code = run.wait(pid)
    assert code in (0, -signal.SIGKILL)
    return run.count() if code else total


def test_a_search_killed_while_its_store_is_made_ends_bit_identically(searches: Searches, whole: Run) -> None:
    for number in range(5):
        run = Run(searches, f"early{number}")
        run.kill_at(0, look=run.await_store, pause=number / 2000)
        run.finish()
        assert_same_end(run, whole)
