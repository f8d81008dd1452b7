"""A model-based search killed at random moments goes on and ends as if nothing had happened."""

from __future__ import annotations

import json
import os
import random
import shutil

import pytest
from faults_world import Run, Searches, assert_same_end, computed
from test_search_killed import content, kill_between

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux")

KILLS = 20
WORDS = (
    "--method",
    "bayesian",
    "--batch",
    "2",
    "--population",
    "4",
    "--generations",
    "6",
    "--evaluations",
    "16",
)


class ModelRun(Run):
    """A search by a model."""

    def start(self, *more: str, **limits: object) -> int:
        return super().start(*WORDS, *more, **limits)


@pytest.fixture(scope="module")
def whole_by_model(searches: Searches) -> Run:
    run = ModelRun(searches, "whole-model")
    run.finish()
    return run


def test_it_repeats_nothing_and_ends_the_same(searches: Searches, whole_by_model: Run) -> None:
    rng, total = random.Random(5), len(whole_by_model.rows())
    killed = tries = 0
    while killed < KILLS:
        tries += 1
        assert tries < 3 * KILLS, "the kill comes too late again and again"
        run = ModelRun(searches, f"model{tries}")
        stored = kill_between(run, rng, total)
        if stored >= total:
            continue
        killed += 1
        kept = run.rows()
        assert content(kept) == content(whole_by_model.rows()[:stored])
        assert computed(run.finish()) == total - stored
        assert run.rows()[:stored] == kept
        assert_same_end(run, whole_by_model)
        shutil.rmtree(run.folder)


def test_a_later_search_learns_from_the_store_and_its_journal_says_so(
    searches: Searches, whole_by_model: Run
) -> None:
    other = ModelRun(searches, "later-model", store=whole_by_model.store)
    before = other.count()
    other.wait(other.start("--seed", "9"))
    lines = [json.loads(line) for line in (other.folder / "journal.jsonl").read_text().splitlines()]
    start = next(line for line in lines if line["event"] == "start")
    assert start["method"] == "bayesian"
    assert len(start["known"]) == before - 1, "all but the base, which no search proposes"
    first = next(line for line in lines if line["event"] == "generation")
    assert ["known"] in [candidate["operators"] for candidate in first["candidates"]]
