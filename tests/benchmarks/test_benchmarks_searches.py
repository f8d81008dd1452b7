"""The searches' benchmark and the simulation of many workers, on cases small enough to know the answer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import ModuleType

import pytest
from benchmark_scripts import imported


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("search", "scale", "exhaustive") as modules:
        yield modules


def test_regret_counts_distinct_subsets_and_ignores_single_sources(
    scripts: tuple[ModuleType, ...],
) -> None:
    scores = {1: 1.0, 2: 9.0, 3: 5.0, 4: 9.0, 5: 4.0, 6: 8.0, 7: 6.0}
    land = scripts[0].Landscape(scripts[2].SubsetScores(("a", "b", "c"), scores, scores))
    assert land.best == 4.0
    assert land.regrets([1, 6, 6, 3, 6, 7, 5]) == [math.inf, 4.0, 1.0, 1.0, 0.0]
    assert scripts[0].greedy_soup(land, 0) == [1, 2, 4, 3, 5]


def test_the_benchmark_walks_the_way_of_the_search(scripts: tuple[ModuleType, ...]) -> None:
    search = scripts[0]
    land = search.Landscape(scripts[2].subset_scores())
    search.check(land)
    row = search.measure("ours", search.genetic(search.SubsetSettings()), land, 2)
    assert row.candidates == 800
    assert list(row.curve) == sorted(row.curve, reverse=True)
    random = search.random_search(land, 0)
    assert len(random) == 800
    assert all(mask.bit_count() >= 2 for mask in random)


def test_workers_wait_at_the_barrier(
    scripts: tuple[ModuleType, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three evaluations of one second on two workers take two; cut into images, one and a half."""
    scale = scripts[1]
    monkeypatch.setattr(scale, "SPREAD", 0.0)
    assert scale.simulate([3], 1.0, 2) == pytest.approx((2.0, 3.0))
    assert scale.simulate([3, 3], 1.0, 2) == pytest.approx((4.0, 6.0))
    assert scale.simulate([3], 1.0, 3) == pytest.approx((1.0, 3.0))
    wall, busy = scale.simulate([3], 1.0, 2, images=40)
    assert wall == pytest.approx(1.5, abs=0.03)
    assert busy == pytest.approx(3.0)
    assert sum(scale.populations(28)) == scale.TRIALS
