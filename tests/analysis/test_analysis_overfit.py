"""Overfit seen by a hold-out, against numbers worked out by hand."""

from __future__ import annotations

import pytest
import scipy.stats
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


def searched(pool: Pool, guiding: float, held: float, holdout: float = 0.5, pairs: int = 8) -> RoutingSearch:
    out = deal([pairs], holdout, 0)[0][0]
    truths = tuple(held if image in out else guiding for image in range(pairs))
    scorer = Evaluator(pool, benchmark(truths=truths, metric="epe"))
    settings = RoutingSettings(evaluations=40, holdout=holdout)
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, settings)
    search.run()
    return search


def test_pairs_that_pull_apart_are_seen_and_said(pool: Pool) -> None:
    """Guiding pairs want 5 px, held-out ones 4 px, where Stage 1 is: what the one gains the other loses."""
    check = holdout_check(searched(pool, 5.0, 4.0, pairs=12), metric="epe")
    assert check.guiding == pytest.approx(-1.0, abs=0.1)
    assert check.held == pytest.approx(1.0, abs=0.1)
    assert check.chosen == 0.0, "x = 0 was kept"
    assert check.overfit
    assert (check.pairs, check.interval) == (6, pytest.approx((check.held, check.held), abs=1e-4))
    assert check.sentence.startswith("Warning: epe changes by -")
    assert f"(chosen among {check.candidates} on these pairs), and by +" in check.sentence
    assert check.sentence.endswith(
        "instead (change +0.00 px, chosen among " + f"{check.candidates} on these pairs)."
    )


def test_under_five_pairs_held_out_there_is_a_difference_and_no_warning(pool: Pool) -> None:
    check = holdout_check(searched(pool, 5.0, 4.0), metric="epe")
    assert (check.pairs, check.interval, check.overfit) == (4, None, False)
    assert "px on 4 held out, which are too few to judge by; the recipe was chosen" in check.sentence


def test_an_interval_is_students_over_the_pairs_held_out(pool: Pool) -> None:
    """Held out are 3.25 to 4.5 px: going from 4 px towards 5 px helps some of them and harms others."""
    out = sorted(deal([12], 0.5, 0)[0][0])
    truths = [5.0] * 12
    for place, image in enumerate(out):
        truths[image] = 3.25 + 0.25 * place
    scorer = Evaluator(pool, benchmark(truths=tuple(truths), metric="epe"))
    search = RoutingSearch(("low", "high"), pool.blocks, scorer, RoutingSettings(evaluations=40, holdout=0.5))
    search.run()
    check = holdout_check(search, metric="epe")
    lead = min(search.candidates, key=lambda c: (c.outcome.parts[0].guiding, c.number))
    before, after = (
        [one.images[image].value("epe") for image in out]
        for one in scorer.evaluate([search.candidates[0].recipe, lead.recipe])
    )
    expected = scipy.stats.ttest_rel(after, before).confidence_interval(0.95)
    assert check.interval == pytest.approx((expected.low, expected.high), abs=1e-6)
    assert check.held == pytest.approx((check.interval[0] + check.interval[1]) / 2)
    assert (check.interval[0] <= 0 <= check.interval[1]) == ("neither gain nor loss" in check.sentence)


def test_pairs_that_agree_are_said_to(pool: Pool) -> None:
    check = holdout_check(searched(pool, 5.0, 5.0, pairs=12), metric="epe")
    assert check.guiding == check.held == check.chosen == pytest.approx(-1.0, abs=0.1)
    assert not check.overfit
    value = f"{check.held:+.2f}"
    assert check.sentence == (
        f"Epe changes by {value} px on the pairs that guide Stage 2 (chosen among {check.candidates} on "
        f"these pairs), and by {value} px on 6 held out: 95 % interval {value} to {value}."
    )


def test_folds_are_averaged(pool: Pool) -> None:
    search = searched(pool, 5.0, 5.0, holdout=4)
    check = holdout_check(search)
    assert (check.folds, check.pairs) == (4, 8)
    assert check.interval is not None
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
