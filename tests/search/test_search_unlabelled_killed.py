"""A search guided by pairs without labels and by labels, killed at random moments, repeats nothing."""

from __future__ import annotations

import os
import random
import shutil

import pytest
from faults_world import Run, Searches, assert_same_end, computed
from test_search_killed import content, kill_between
from tiny import write_pairs

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux")

KILLS = 4
GUIDES = {
    "alone": ("-b", "unlabelled", "-r", "drive", "--metric", "census"),
    "with labels": (
        *("-b", "unlabelled", "-r", "drive", "--metric", "census"),
        *("--also", "pairs,root=drive,metric=epe"),
    ),
}


class UnlabelledRun(Run):
    """A search guided by census, alone or combined with labels by change against uniform."""

    guide: str

    def start(self, *more: str, **limits: object) -> int:
        return super().start(*GUIDES[self.guide], "--evaluations", "10", *more, **limits)


@pytest.mark.parametrize("guide", GUIDES)
def test_it_repeats_nothing_and_ends_the_same(searches: Searches, guide: str) -> None:
    def named(name: str) -> UnlabelledRun:
        run = UnlabelledRun(searches, f"{guide.replace(' ', '-')}-{name}")
        run.guide = guide
        return run

    write_pairs(searches.world / "drive", 2)
    whole = named("whole")
    document = whole.finish()
    assert document["trust"]["pairs"] == 2
    assert (document["trust"]["agreement"] is None) == (guide == "alone")
    rng, total = random.Random(11), len(whole.rows())
    killed = tries = 0
    while killed < KILLS // len(GUIDES):
        tries += 1
        assert tries < 3 * KILLS, "the kill comes too late again and again"
        run = named(str(tries))
        stored = kill_between(run, rng, total)
        if stored >= total:
            continue
        killed += 1
        kept = run.rows()
        assert content(kept) == content(whole.rows()[:stored])
        again = run.finish()
        assert computed(again) == total - stored
        assert again["trust"] == document["trust"]
        assert run.rows()[:stored] == kept
        assert_same_end(run, whole)
        shutil.rmtree(run.folder)
