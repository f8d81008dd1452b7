"""Overfit seen by a hold-out, and learning curves, against numbers worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from flat_world import benchmark, flat_pool

from sfkit.analysis.generalisation import Trial, run_trials
from sfkit.analysis.overfit import HoldoutCheck, holdout_check, learning_curve
from sfkit.errors import InputError
from sfkit.evaluation import CombinedScorer, EvaluationStore, Evaluator
from sfkit.evaluation.holdout import deal
from sfkit.merging import BlockPartition, Pool
from sfkit.search import RoutingSearch, RoutingSettings


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    """The equal merge of the two sources has a level of 4 px."""
    return flat_pool(tmp_path_factory.mktemp("flat"), {"low": 2.0, "high": 6.0})


def searched(pool: Pool, guiding: float, held: float, holdout: float = 0.5) -> RoutingSearch:
    out = deal([8], holdout, 0)[0][0]
    truths = tuple(held if image in out else guiding for image in range(8))
    scorer = Evaluator(pool, benchmark(truths=truths, metric="epe"))
    settings = RoutingSettings(evaluations=40, holdout=holdout)
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, settings)
    search.run()
    return search


def test_pairs_that_pull_apart_are_seen_and_said(pool: Pool) -> None:
    """Guiding pairs want 5 px, held-out ones 4 px, where Stage 1 is: what the one gains the other loses."""
    check = holdout_check(searched(pool, 5.0, 4.0), metric="epe")
    assert check.guiding == pytest.approx(-1.0, abs=0.1)
    assert check.held == pytest.approx(1.0, abs=0.1)
    assert check.chosen == 0.0, "x = 0 was kept"
    assert check.overfit
    assert check.sentence.startswith("Warning: epe falls by ")
    assert "and does not fall on those held out (change +" in check.sentence
    assert check.sentence.endswith("chosen on the held-out pairs instead (change +0.00 px).")


def test_pairs_that_agree_are_said_to(pool: Pool) -> None:
    check = holdout_check(searched(pool, 5.0, 5.0), metric="epe")
    assert check.guiding == check.held == check.chosen == pytest.approx(-1.0, abs=0.1)
    assert not check.overfit
    assert (
        check.sentence
        == f"Epe falls by {-check.guiding:.2f} px on the pairs that guide Stage 2 and by "
        + (f"{-check.held:.2f} px on those held out.")
    )


def test_folds_are_averaged(pool: Pool) -> None:
    search = searched(pool, 5.0, 5.0, holdout=4)
    check = holdout_check(search)
    assert check.folds == 4
    assert check.guiding < -0.5
    best = search.best
    assert check.chosen == pytest.approx(best.score - search.candidates[0].score)


def test_without_a_hold_out_there_is_nothing_to_check(pool: Pool) -> None:
    scorer = Evaluator(pool, benchmark(metric="epe"))
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, RoutingSettings(evaluations=20))
    search.step()
    assert holdout_check(search) is None


def test_equal_weights_that_stay_best_are_no_overfit() -> None:
    check = HoldoutCheck(0.0, 0.0, 0.0, 1)
    assert not check.overfit
    assert check.sentence.startswith("Stage 2 found nothing better than equal weights (score on the pairs")


def test_trials_by_hand_and_through_the_store(pool: Pool, tmp_path: Path) -> None:
    """Validation wants 5 px; the judge 3 px, 1 px from Stage 1: what Stage 2 gains the judge loses."""
    split = BlockPartition.of({"one": ["offset", "level"]})
    settings = RoutingSettings(evaluations=30, converge=False)
    trials = [
        Trial("plain", settings),
        Trial("half", settings, shorten=0.5),
        Trial("one", settings, partition=split),
    ]
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        scorer = CombinedScorer([Evaluator(pool, benchmark(truths=(5.0,), metric="epe"), store=store)])
        judge = Evaluator(pool, benchmark("judge", (3.0,), metric="epe"), store=store)
        table = run_trials(trials, pool, ("low", "high"), scorer, {"judge": judge}, seeds=(0, 1), marks=(10,))
        before = len(store)
        again = run_trials(trials, pool, ("low", "high"), scorer, {"judge": judge}, seeds=(0, 1), marks=(10,))
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


def rows() -> pd.DataFrame:
    columns = ["pairs", "trial", "seed", "evaluations", "validation", "equal", "a", "a:equal", "b", "b:equal"]
    return pd.DataFrame(
        [
            (2, "plain", 0, 20, 9.0, 10.0, 21.0, 20.0, 31.0, 30.0),
            (2, "plain", 0, 80, 7.0, 10.0, 22.0, 20.0, 32.0, 30.0),
            (2, "plain", 1, 80, 8.0, 10.0, 20.0, 20.0, 30.0, 30.0),
            (5, "plain", 0, 80, 9.0, 10.0, 19.0, 20.0, 28.0, 30.0),
            (5, "half", 0, 80, math.nan, 10.0, 19.0, 20.0, 29.0, 30.0),
        ],
        columns=columns,
    )


def test_a_curve_along_pairs_by_hand() -> None:
    curve = learning_curve(rows(), ["a", "b"], metric="bad-3.0")
    assert (curve.trials, curve.places) == (("plain", "half"), (2, 5))
    np.testing.assert_allclose(curve.unseen, [[1.0, -1.5], [math.nan, -1.0]])
    np.testing.assert_allclose(curve.lowest[0], [0.0, -1.5])
    np.testing.assert_allclose(curve.highest[0], [2.0, -1.5])
    np.testing.assert_allclose(curve.validation, [[-2.5, -1.0], [math.nan, math.nan]])
    assert curve.runs.tolist() == [[2, 1], [0, 1]]


def test_a_curve_along_evaluations_by_hand() -> None:
    curve = learning_curve(rows(), ["a"], along="evaluations", trials=["plain"])
    assert curve.places == (20, 80)
    np.testing.assert_allclose(curve.unseen, [[1.0, (2.0 + 0.0 - 1.0) / 3]])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"along": "time"}, "along: found 'time', expected pairs or evaluations"),
        ({"judges": ["c"]}, "judges: found 'c', which is no benchmark"),
        ({"judges": []}, "learning curve: found nothing to average"),
    ],
)
def test_curves_that_cannot_be_are_refused(arguments: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        learning_curve(rows(), **{"judges": ["a"], **arguments})
