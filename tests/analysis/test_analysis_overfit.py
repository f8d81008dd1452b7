"""Overfit seen by a hold-out, against numbers worked out by hand."""

from __future__ import annotations

import pytest
from flat_world import benchmark, flat_pool

from sfkit.analysis.overfit import HoldoutCheck, holdout_check
from sfkit.evaluation import Evaluator
from sfkit.evaluation.holdout import deal
from sfkit.merging import Pool
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
