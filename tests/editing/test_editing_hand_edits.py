"""Edits that were scored by hand are remembered in the store, and found wherever their pairs are reported."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import write_pairs

from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.editing import mark_hand_edit, seen_by_hand
from sfkit.evaluation import EvaluationStore


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    return open_benchmark("pairs", write_pairs(tmp_path_factory.mktemp("world") / "pairs", count=3))


def test_edits_are_found_by_the_pairs_they_saw(benchmark: Benchmark, tmp_path: Path) -> None:
    first = benchmark.first(1)
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        assert seen_by_hand(store, [benchmark]) == ()
        for key in ("one", "two", "one"):
            mark_hand_edit(store, key, first)
        mark_hand_edit(store, "three", benchmark.select(["pair1"]))
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        (found,) = seen_by_hand(store, [benchmark])
        assert (found.edits, found.pairs) == (3, ("pair0", "pair1"))
        assert str(found).startswith("pairs: 3 recipes edited by hand were scored on 2 of its pairs")
        assert seen_by_hand(store, [benchmark.select(["pair2"])]) == ()
        (subset,) = seen_by_hand(store, [first])
        assert (subset.edits, subset.pairs) == (2, ("pair0",))


def test_a_mark_is_no_evaluation(tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "store.sqlite") as store:
        store.mark("key", "mark", "detail")
        store.mark("key", "mark", "other")
        assert store.marks("mark") == (("key", "detail"),)
        assert store.marks("other") == ()
        assert (len(store), store.get("key")) == (0, None)
