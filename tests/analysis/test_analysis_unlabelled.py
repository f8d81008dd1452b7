"""A guide without ground truth wherever a validation benchmark may stand: tables, ablations, figures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from flat_world import benchmark, flat_pool

import sfkit
from sfkit import analysis, figures
from sfkit.baselines import baseline_named
from sfkit.datasets import Benchmark
from sfkit.errors import InputError

LEVELS = {"low": 4.0, "high": 8.0, "higher": 12.0}
SHIFT = 6


@pytest.fixture
def drive(tmp_path: Path) -> Benchmark:
    """Three frames of blobs whose true disparity is 6 px, and nothing that says so."""
    for frame in range(3):
        noise = np.random.default_rng(frame).integers(0, 256, (20, 36, 3), dtype=np.uint8)
        wide = cv2.resize(noise, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        for side, view in (("left", wide[:, :60]), ("right", wide[:, SHIFT : 60 + SHIFT])):
            (tmp_path / "drive" / side).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(tmp_path / "drive" / side / f"{frame}.png"), view)
    return sfkit.open_benchmark("unlabelled", tmp_path / "drive")


@pytest.fixture
def experiment(drive: Benchmark, tmp_path: Path) -> analysis.Experiment:
    truths = {"here": (5.0, 6.0, 7.0), "there": (5.5, 6.25, 6.5)}
    tests = tuple(benchmark(name, each, metric="epe") for name, each in truths.items())
    store = sfkit.EvaluationStore(tmp_path / "store.sqlite")
    budgets = {"population": 8, "generations": 4, "evaluations": 4}
    return analysis.Experiment(flat_pool(tmp_path / "pool", LEVELS), drive, tests, store, **budgets)  # type: ignore[arg-type]


def test_the_guide_is_shown_by_census_and_the_tests_by_their_labels(experiment: analysis.Experiment) -> None:
    scores = experiment.scores({"low": experiment.pool.equal("low"), "high": experiment.pool.equal("high")})
    shown = dict(scores.groupby("benchmark")["metric"].first())
    assert shown == {"drive": "census", "here": "epe", "there": "epe"}
    by_hand = scores.query("benchmark == 'here'").set_index("network")["score"]
    assert by_hand.to_dict() == pytest.approx({"low": 2.0, "high": 2.0})
    assert list(sfkit.pivot(scores).columns)[-1] == "mean of unseen epe [px]"
    figures.scores_figure(analysis.score_grid(scores))


def test_every_method_is_judged_by_labels_it_never_saw(experiment: analysis.Experiment) -> None:
    names = ("single_best", "uniform", "stage1", "stage1_2")
    study = analysis.study(experiment, seeds=1, methods=names)
    assert study.metric == "epe"
    table = study.table()
    assert [c for c in table.columns if c.startswith("drive")] == ["drive (all-valid) census [%] *"]
    # 6 px is what the two middle levels make together: census finds it without being told.
    assert study.runs["Stage 1, seed 0"].recipe.sources == ("low", "high")
    assert study.mean("Stage 1, seed 0") == pytest.approx((2 / 3 + 1.25 / 3) / 2)
    assert any("on drive" in line for line in analysis.summary(study))
    study.sources_table(), study.cost_table()
    figures.comparison_figure(study.comparison)
    figures.scores_figure(analysis.score_grid(study.scores()))


def test_ablations_ask_it_nothing_it_cannot_answer(experiment: analysis.Experiment) -> None:
    tests = tuple(test.measured_by(metric="bad-1.0") for test in experiment.reported)
    changed = experiment.changed(reported=tests)
    by_metric = analysis.fitness_metrics(experiment, ("census", "bad-1.0", "epe"), routing=False)
    assert list(by_metric.index) == ["census"]
    sets = analysis.validation_sets(changed, routing=False)
    assert sets["mean"].isna().all(), "percents of bits and of pixels have no mean"
    assert sets["mean of the unseen"].notna().tolist() == [True, False, False], (
        "the guide of one is not in it"
    )
    assert len(analysis.stage_variants(experiment)) == 4
    probes = analysis.block_probes(experiment.scorer(), ("low", "high"), validation=True)
    assert (probes.metric, probes.unit) == ("census", "%")
    curves = analysis.interpolation_curves(
        experiment.scorers(), {"line": (experiment.pool.base_recipe(), experiment.pool.equal("high"))},
        positions=[0.0, 1.0], validation=("drive",),
    )  # fmt: skip
    titles = [axis.title.text for axis in figures.interpolation_figure(curves).select_yaxes()]
    assert titles == ["census (% of census bits)", "EPE (px)", None]


def test_pictures_and_methods_that_need_labels_say_so(experiment: analysis.Experiment) -> None:
    recipes = {"uniform": experiment.pool.uniform()}
    panels = analysis.disparity_panels(
        experiment.pool, recipes, experiment.validation, metrics=["bad-3.0", "census"]
    )
    assert list(panels.networks[0].scores) == ["census"]
    with pytest.raises(InputError, match="found the metric census, which is counted over whole images"):
        analysis.region_scores(experiment.scorer(), recipes)
    with pytest.raises(InputError, match="fisher: drive has no ground truth"):
        baseline_named("fisher")(experiment.pool, experiment.scorer())
    with pytest.raises(InputError, match="has no ground truth"):
        experiment.scorer(metric="bad-1.0")
