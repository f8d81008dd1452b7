"""Ways to run Stage 2 side by side: what they gain and lose, against numbers worked out by hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from benchmark_scripts import imported
from flat_world import benchmark, flat_pool

from sfkit.evaluation import CombinedScorer, EvaluationStore, Evaluator
from sfkit.merging import BlockPartition
from sfkit.search import RoutingSettings


@pytest.fixture(scope="module")
def trials() -> Iterator[ModuleType]:
    with imported("trials") as (module,):
        yield module


def test_trials_by_hand_and_through_the_store(trials: ModuleType, tmp_path: Path) -> None:
    """Validation wants 5 px; the judge 3 px, 1 px from Stage 1: what Stage 2 gains the judge loses."""
    pool = flat_pool(tmp_path, {"low": 2.0, "high": 6.0})  # their equal merge has a level of 4 px
    split = BlockPartition.of({"one": ["offset", "level"]})
    settings = RoutingSettings(evaluations=30, converge=False)
    ways = [
        trials.Trial("plain", settings),
        trials.Trial("half", settings, shorten=0.5),
        trials.Trial("one", settings, partition=split),
    ]
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        scorer = CombinedScorer([Evaluator(pool, benchmark(truths=(5.0,), metric="epe"), store=store)])
        judge = Evaluator(pool, benchmark("judge", (3.0,), metric="epe"), store=store)
        table = trials.run_trials(
            ways, pool, ("low", "high"), scorer, {"judge": judge}, seeds=(0, 1), marks=(10,)
        )
        before = len(store)
        again = trials.run_trials(
            ways, pool, ("low", "high"), scorer, {"judge": judge}, seeds=(0, 1), marks=(10,)
        )
        assert len(store) == before, "run again it computes nothing"
    pd.testing.assert_frame_equal(table, again)
    assert table.groupby("trial").size().to_dict() == {"plain": 4, "half": 2, "one": 4}
    assert (table["equal"] == 1.0).all()
    assert (table["judge:equal"] == 1.0).all()
    ends = table[(table["evaluations"] == 30)]
    plain = ends[ends["trial"] == "plain"]
    # Level L: |L - 5| on validation, L - 3 for the judge, so that the two sum to 2 up to 5 px.
    assert (plain["validation"] + plain["judge"]).tolist() == pytest.approx([2.0, 2.0], abs=0.3)
    assert (plain["judge"] > 1.5).all()
    half = ends[ends["trial"] == "half"]
    assert half["distance"].tolist() == pytest.approx((plain["distance"] / 4).tolist())
    assert (half["judge"].to_numpy() < plain["judge"].to_numpy()).all()
    assert half["validation"].isna().all()


def test_changes_are_against_equal_weights_and_one_without_a_score_has_none(trials: ModuleType) -> None:
    columns = ["validation", "equal", "a", "a:equal", "b", "b:equal"]
    rows = [(9.0, 10.0, 21.0, 20.0, 31.0, 28.0), (8.0, 10.0, float("nan"), 20.0, 30.0, 30.0)]
    found = trials.with_changes(pd.DataFrame(rows, columns=columns), ["a", "b"])
    assert found["change"].tolist() == [-1.0, -2.0]
    assert found["unseen"][0] == 2.0
    assert found["unseen"].isna().tolist() == [False, True]
