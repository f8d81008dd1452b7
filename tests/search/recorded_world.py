"""A search whose store and result an earlier version left in ``tests/search/recorded``.

``python recorded_world.py FOLDER``, run with sfkit of commit 20dfb95, wrote the files there. The networks and
pairs of :mod:`flat_world` are exact in float32, so that every machine has the same fingerprints and scores.
"""

from __future__ import annotations

import gzip
import shutil
import sys
from pathlib import Path

import flat_world

from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import SearchResult, search_pool
from sfkit.search.plan import SearchPlan

LEVELS = {"a": 4.0, "b": 12.0, "c": -8.0, "d": 90.0, "e": 6.5}
PLAN = SearchPlan(
    stage1=SubsetSettings(population=6, generations=3, seed=5),
    stage2=RoutingSettings(evaluations=18, seed=5),
)
STORE, JOURNAL, RESULT = "evaluations.sqlite.gz", "journal.jsonl.gz", "result.json"


def search(folder: Path, store: Path) -> tuple[SearchResult, Evaluator]:
    """Both stages, scored in pixels: what they found, and what that took."""
    pool = flat_world.flat_pool(folder / "pool", LEVELS)
    pairs = flat_world.benchmark(truths=(5.625,), metric="epe")
    with EvaluationStore(store) as kept, Evaluator(pool, pairs, store=kept) as evaluator:
        return search_pool(pool, evaluator, PLAN, folder / "out"), evaluator


if __name__ == "__main__":
    here, work = Path(__file__).parent / "recorded", Path(sys.argv[1])
    found, _ = search(work, work / "evaluations.sqlite")
    shutil.copy(found.folder / RESULT, here / RESULT)
    for name, file in ((STORE, work / "evaluations.sqlite"), (JOURNAL, found.folder / "journal.jsonl")):
        (here / name).write_bytes(gzip.compress(file.read_bytes(), mtime=0))
