"""The overhead's rows add up, and count what a search did."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


def test_rows_add_up_and_images_are_prepared_before_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    overhead = importlib.import_module("overhead")
    monkeypatch.setattr(overhead, "SIZE", (32, 256))
    found = overhead.measure(pairs=2, population=2, generations=1, evaluations=3, method="bayesian")
    rows = {row["part"]: row for row in found["rows"]}
    assert sum(row["share"] for row in rows.values()) == pytest.approx(1)
    assert sum(row["seconds"] for row in rows.values()) == pytest.approx(found["seconds"])
    assert found["outside"] == pytest.approx(1 - rows["forward passes"]["share"])
    searched = found["evaluations"] - 1  # the first one warmed up
    assert rows["forward passes"]["calls"] == 2 * searched
    assert rows["errors of predictions"]["calls"] == 2 * (searched + 1), "the written network's as well"
    assert rows["store: write"]["calls"] == searched
    assert rows["merge"]["calls"] == searched + 1
    assert "prepare images" not in rows
    assert rows["model of subsets"]["calls"] == 1
    assert rows["model of routings"]["calls"] == 2, "x = 0 is no proposal"


def test_what_the_store_holds_before_is_learned_from_and_not_computed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    overhead = importlib.import_module("overhead")
    monkeypatch.setattr(overhead, "SIZE", (32, 256))
    seen: list[int] = []
    monkeypatch.setattr(
        overhead.SearchPlan,
        "known",
        lambda plan, *places, known=overhead.SearchPlan.known: (
            seen.append(len(known(plan, *places))) or known(plan, *places)
        ),
    )
    found = overhead.measure(1, 2, 1, 3, "bayesian", known=30)
    assert seen == [31], "the warming one beside those that were put there"
    assert found["known"] == 30
    assert found["evaluations"] < 20, "sources alone and proposals; nothing that was put there"
