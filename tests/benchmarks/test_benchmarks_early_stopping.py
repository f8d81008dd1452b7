"""Early stopping, replayed on tables: the search's own path, ties included, from fewer images."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sfkit.evaluation import Outcome
from sfkit.search import SubsetSearch, SubsetSettings

FOLDER = Path(__file__).parents[2] / "benchmarks"
NAMES = tuple("abcdefg")
IMAGES = 6


@pytest.fixture(scope="module")
def early() -> Iterator[ModuleType]:
    """``benchmarks/early_stopping.py``."""
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("early_stopping")
    sys.path.remove(str(FOLDER))
    del sys.modules["early_stopping"]


def table(seed: int, *, tied: bool) -> dict[frozenset[int], list[float]]:
    """Errors by subset; ``tied`` ones are whole numbers, so that many scores are equal."""
    rng = np.random.default_rng(seed)
    subsets = [frozenset(c) for size in range(2, 8) for c in combinations(range(7), size)]
    errors = (
        rng.integers(0, 3, (len(subsets), IMAGES)) if tied else rng.exponential(9, (len(subsets), IMAGES))
    )
    return {genes: [float(e) for e in row] for genes, row in zip(subsets, errors, strict=True)}


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("tied", [False, True])
def test_a_replay_goes_the_way_of_the_search_and_looks_at_fewer_images(
    early: ModuleType, tied: bool, lazy: bool
) -> None:
    for seed in range(8):
        errors = table(seed, tied=tied)

        def scorer(recipes, errors=errors):
            return [Outcome(early.mean(errors[frozenset(map(NAMES.index, r.sources))])) for r in recipes]

        search = SubsetSearch(NAMES, ("b",), scorer, SubsetSettings(population=9, generations=4, seed=seed))
        best = search.run()
        watch = early.Watch(errors, range(IMAGES))
        way = early.replay(search, watch, lazy=lazy)
        early.check(search, way)
        genes = early.genes_of(search, best.number)
        assert watch.exact(genes), "the best is known exactly"
        assert watch.bound(genes) == best.score
        asked = {early.genes_of(search, c.number) for c in search.candidates}
        assert set(watch.seen) <= asked
        assert 0 < watch.passes < len(asked) * IMAGES


def test_another_way_is_noticed(early: ModuleType) -> None:
    errors = table(0, tied=False)
    search = SubsetSearch(
        NAMES,
        ("b",),
        lambda recipes: [
            Outcome(early.mean(errors[frozenset(map(NAMES.index, r.sources))])) for r in recipes
        ],
        SubsetSettings(population=9, generations=4),
    )
    search.run()
    upside_down = {genes: [100 - e for e in row] for genes, row in errors.items()}
    with pytest.raises(RuntimeError, match="the replay went another way"):
        early.check(search, early.replay(search, early.Watch(upside_down, range(IMAGES)), lazy=True))
