"""A metric added from outside is scored, stored, tabled, compared and drawn like sfkit's own."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import own_metrics
import pytest
from flat_world import LEVELS, SIZE, benchmark, flat_pool, sample

from sfkit import figures
from sfkit.analysis import disparity_panels, score_grid
from sfkit.analysis.labels import metric_label, score_text
from sfkit.analysis.measured import measure_recipes
from sfkit.datasets import Metric, memory_benchmark, register_metric
from sfkit.datasets.protocols import rule
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator, pivot, score_recipes
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.store import evaluation_key

NAMES = ("low", "high")


@pytest.fixture
def store() -> EvaluationStore:
    return EvaluationStore(":memory:")


def share(level: float) -> float:
    """Percent of columns to the left of a disparity of that many pixels."""
    return 100.0 * math.ceil(level) / SIZE[1]


def test_an_evaluator_keeps_its_own_sums_beside_the_errors(tmp_path: Path, store: EvaluationStore) -> None:
    pool = flat_pool(tmp_path)
    evaluator = Evaluator(pool, benchmark(), store=store, metric="outside", also=["bad-1.0", "squared"])
    recipes = [pool.equal(name) for name in NAMES]
    assert [outcome.score for outcome in evaluator(recipes)] == [share(4.0), share(12.0)]
    held = evaluator.evaluate(recipes)[0]
    assert held.cached, "what the metric counted came back from the store"
    assert [image.value("squared") for image in held.images] == [1.0, 16.0]  # levels 4; truths 5 and 8
    assert evaluator.score(held.images, "squared") == 8.5
    assert evaluator.score(held.images, "bad-1.0") == 50.0
    assert ImageErrors.from_dict(held.images[0].to_dict()) == held.images[0]
    assert own_metrics.made.count("pair1") == 1, "what depends on the pair alone is made once"
    own_metrics.made.clear()


def test_a_metric_may_count_where_networks_run(tmp_path: Path) -> None:
    evaluator = Evaluator(flat_pool(tmp_path), benchmark(), metric="placed")
    assert evaluator.evaluate([evaluator.pool.base_recipe()])[0].images[0].value("placed") == 0.0
    map_ = np.zeros(SIZE, np.float32)
    told = [evaluator.prepared.errors(0, map_, device).value("placed") for device in ("cuda:3", "cuda:2")]
    assert told == [3.0, 2.0]


def test_keys_tell_what_was_counted(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    plain, own = (Evaluator(pool, benchmark(), also=also) for also in ((), ("outside",)))
    recipe = pool.uniform()
    assert evaluation_key(plain.describe(recipe)) != evaluation_key(own.describe(recipe))
    assert own.describe(recipe) == {**plain.describe(recipe), "own": {"outside": "1"}}
    image = plain.evaluate([pool.base_recipe()])[0].images[0]
    assert "own" not in image.to_dict(), "rows without such a metric are what they were"
    with pytest.raises(InputError, match=r"'pair0': outside was not recorded, .*also=\['outside'\]"):
        image.value("outside")


def test_a_pair_without_ground_truth(tmp_path: Path, store: EvaluationStore) -> None:
    pool = flat_pool(tmp_path)
    bare = memory_benchmark("bare", [sample("one", math.nan)], metric="outside")
    evaluator = Evaluator(pool, bare, store=store)
    assert evaluator([pool.equal("high")])[0].score == share(12.0)
    image = evaluator.evaluate([pool.equal("below")])[0].images[0]
    assert (image.pixels, image.flagged, image.value("outside")) == (0, True, 100.0)
    with pytest.raises(InputError, match="'one': has no ground truth, expected a metric that needs none"):
        image.value("epe")
    for metric in ("bad-1.0", "squared"):
        with pytest.raises(InputError, match=r"one: protocol 'all-valid' found no valid pixel"):
            Evaluator(pool, bare, metric=metric)


def test_tables_and_a_figure_show_it(tmp_path: Path, store: EvaluationStore) -> None:
    pool = flat_pool(tmp_path)
    recipes = {name: pool.equal(name) for name in NAMES}
    scores = score_recipes(pool, recipes, [benchmark()], metrics=["outside", "squared"], store=store)
    table = pivot(scores)
    assert list(table) == ["noise (all-valid) outside [%]", "noise (all-valid) squared [px²]"]
    assert table.loc["high"].tolist() == [share(12.0), (49.0 + 16.0) / 2]
    figure = figures.scores_figure(score_grid(scores))
    drawn = {value for trace in figure.data for value in np.ravel(np.asarray(trace["x"], float))}
    assert {share(4.0), share(12.0), 8.5, 32.5} <= drawn
    measured = measure_recipes(pool, recipes, [benchmark()], metric="squared", store=store)[0]
    assert (measured.unit, measured.score("high")) == ("px²", 32.5)
    assert measured.terms("high")[0].tolist() == [49.0, 16.0]
    panels = disparity_panels(pool, recipes, benchmark(), metrics=["within-1"])
    assert (panels.threshold, panels.networks[0].scores) == (1.0, {"within-1": 100.0})
    assert (metric_label("outside"), score_text("squared", 8.5)) == ("outside (% of matches)", "MSE 8.50 px²")


def test_pooling_is_the_metrics_own_word() -> None:
    unequal = [
        ImageErrors(n, (), 0, {}, {"outside": r, "squared": r})
        for n, r in (("a", (10.0, 1.0)), ("b", (0.0, 4.0)))
    ]
    assert rule("raft", "kitti").aggregate(unequal, "outside") == 2.0
    assert rule("raft", "kitti").aggregate(unequal, "squared") == 5.0
    assert rule("nmrf", "kitti").aggregate(unequal, "outside") == 5.0
    with pytest.raises(InputError, match="outside is of the whole image, found region 'visible'"):
        unequal[0].value("outside", "visible")


def test_more_is_better_guides_nothing(tmp_path: Path, store: EvaluationStore) -> None:
    pool = flat_pool(tmp_path)
    evaluator = Evaluator(pool, benchmark(), store=store, metric="within-1")
    with pytest.raises(
        InputError, match=r"metric within-1: more of it is better, .*expected a metric of which less"
    ):
        evaluator([pool.uniform()])
    assert evaluator.score(evaluator.evaluate([pool.base_recipe()])[0].images) == 50.0


def test_it_travels_to_worker_processes(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    with Evaluator(pool, benchmark(), metric="outside", engine="processes", workers=1) as evaluator:
        assert evaluator([pool.equal("low")])[0].score == share(4.0)


@pytest.mark.parametrize("name", ["epe", "bad-2.0", "Upper", ""])
def test_names_that_cannot_be_registered(name: str) -> None:
    with pytest.raises(InputError, match="expected a name in lower case that is none of sfkit's own"):
        register_metric(Metric(name, recorder=own_metrics.squared))


def test_a_metric_that_counts_nothing() -> None:
    with pytest.raises(InputError, match=r"metric 'empty': expected either counts, .*or a recorder"):
        Metric("empty")
    assert set(LEVELS) > set(NAMES)
