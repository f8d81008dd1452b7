"""A search's networks beside those that need none, on networks of one level, scored by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from flat_world import benchmark, flat_spec

from sfkit import EvaluationStore, Evaluator, Recipe, open_pool
from sfkit.analysis import Support
from sfkit.analysis.search_verdict import SearchVerdict, search_verdict

LEVELS = {"one": 1.0, "five": 5.0, "ten": 10.0}


def found(folder: Path, unseen: float) -> SearchVerdict:
    """Guided by 3.2 px; Stage 1 is 3.0 everywhere, Stage 1+2 is 3.2; ``unseen`` is the truth elsewhere."""
    pool = open_pool(flat_spec(folder, LEVELS, base=4.5))
    store = EvaluationStore(":memory:")
    truths = tuple(n / 100 for n in range(6))
    guide = benchmark("guide", tuple(3.2 + t for t in truths), metric="epe")
    test = benchmark("test", tuple(unseen + t for t in truths), metric="epe")
    one, five = 0.45, 0.55  # 0.45 * 1 + 0.55 * 5 = 3.2
    mixed = Recipe(("one", "five"), pool.blocks, ((one, five),) * len(pool.blocks), (1.0,) * len(pool.blocks))
    return search_verdict(
        pool,
        {"Stage 1": pool.equal("one", "five"), "Stage 1+2": mixed},
        [Evaluator(pool, guide, store=store)],
        [Evaluator(pool, test, store=store)],
        evaluations={"Stage 1": 4, "Stage 1+2": 24},
    )


def test_a_stage_2_that_holds_elsewhere_is_recommended(tmp_path: Path) -> None:
    told = found(tmp_path, 4.0)
    assert told.verdict.recommended == "Stage 1+2"
    assert told.verdict.support is Support.SHOWN
    assert told.single == "five"
    assert [row.network for row in told.comparison.rows] == [
        "base",
        "best single (five)",
        "uniform",
        "Stage 1",
        "Stage 1+2",
    ]
    scores = {row.network: row.guided for row in told.comparison.rows}
    # Truths are 3.2 to 3.25: five is 1.775 off at the mean, the equal mixture of all (16 / 3) 2.108.
    assert scores["best single (five)"] == pytest.approx(1.775, abs=1e-5)
    assert scores["uniform"] == pytest.approx(16 / 3 - 3.225, abs=1e-5)
    assert scores["Stage 1+2"] == pytest.approx(0.025, abs=1e-5)
    assert told.lines[0] == told.verdict.sentence
    assert told.lines[1].split() == ["network", "validation", "unseen", "against", "best", "single", "(five)"]
    assert told.lines[-1].startswith("  Stage 1+2")
    difference = told.comparison.rows[-1].difference
    assert difference is not None
    assert told.lines[-1].endswith(difference.short)
    # On the test five is 0.975 off at the mean, and 3.2 is 0.825.
    assert difference.short.startswith("better, -0.15 [")
    assert max(map(len, told.lines[1:])) <= 80
    # An interval is that of one difference alone; the word is told of all of them together.
    many = replace(difference, p=0.06, family=4)
    rows = (*told.comparison.rows[:-1], replace(told.comparison.rows[-1], unseen_difference=many))
    lines = replace(told, comparison=replace(told.comparison, rows=rows)).lines
    assert lines[-2].endswith(many.short)
    assert many.short.startswith("within noise, -0.15 [")
    assert lines[-1] == "  within noise though its interval leaves 0 out: one of 4 comparisons"


def test_a_stage_2_that_fits_its_pairs_is_overruled(tmp_path: Path) -> None:
    told = found(tmp_path, 2.0)
    assert told.verdict.preferred == "Stage 1+2"
    assert told.verdict.recommended == "Stage 1"
    assert told.lines[0].startswith("Stage 2 is not supported here: take Stage 1.")


def test_a_single_source_that_fits_its_pairs_is_overruled_by_what_holds_elsewhere(tmp_path: Path) -> None:
    pool, store = open_pool(flat_spec(tmp_path, LEVELS, base=4.5)), EvaluationStore(":memory:")
    guide = benchmark("guide", tuple(4.9 + n / 100 for n in range(6)), metric="epe")
    test = benchmark("test", tuple(3.0 + n / 100 for n in range(6)), metric="epe")
    told = search_verdict(
        pool,
        {"Stage 1": pool.equal("one", "five")},
        [Evaluator(pool, guide, store=store)],
        [Evaluator(pool, test, store=store)],
    ).verdict
    assert told.preferred == "best single (five)", "5 px, where the truth of the guide is 4.9"
    assert (told.recommended, told.support) == ("Stage 1", Support.OVERRULED)
    assert told.sentence.startswith("best single (five) is not supported here: take Stage 1.")
