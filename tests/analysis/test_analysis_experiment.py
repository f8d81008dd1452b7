"""Each benchmark under its own metric: every table shows what an evaluator of that metric says by itself."""

from __future__ import annotations

import math

import pytest
from flat_world import benchmark, flat_spec

from sfkit import EvaluationStore, Evaluator, open_pool
from sfkit.analysis import Experiment, study
from sfkit.analysis.ablations import MEAN, scored

LEVELS = {"one": 1.0, "five": 5.0, "ten": 10.0}
METRICS = {"guide": "bad-1.0", "road": "d1", "room": "bad-2.0"}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    truths = {"guide": (3.1, 6.5), "road": (1.5, 8.0), "room": (2.9, 7.4)}
    guide, *reported = (benchmark(n, levels, metric=METRICS[n]) for n, levels in truths.items())
    return Experiment(
        pool=open_pool(flat_spec(tmp_path_factory.mktemp("pool"), LEVELS, base=4.5)),
        validation=guide,
        reported=tuple(reported),
        store=EvaluationStore(":memory:"),
        population=6,
        generations=1,
        evaluations=8,
        own_metrics=True,
    )


def alone(experiment: Experiment, network: str) -> dict[str, float]:
    """What an evaluator of each benchmark, on a store of its own, says of a source or the base."""
    pool = experiment.pool
    recipe = pool.base_recipe() if network == "base" else pool.equal(network)
    return {one.name: Evaluator(pool, one)([recipe])[0].score for one in experiment.columns}


def test_the_tables_of_a_study_have_a_metric_for_each_column(experiment: Experiment) -> None:
    found = study(experiment, seeds=1, methods=["uniform"])
    assert {one.benchmark: one.metric for one in found.measured} == METRICS
    assert found.metric is None, "the columns share none"
    sources = found.sources_table().rename(columns=lambda name: name.removesuffix(" *"))
    for network in ("base", *LEVELS):
        assert sources.loc[network, list(METRICS)].to_dict() == alone(experiment, network)
    main = found.table().loc["base"]
    expected = alone(experiment, "base")
    assert [main[f"{n} (all-valid) {m} [%]{' *' * (n == 'guide')}"] for n, m in METRICS.items()] == [
        *expected.values()
    ]
    assert main["mean of unseen [%]"] == (expected["road"] + expected["room"]) / 2
    long = found.scores().set_index(["network", "benchmark"])
    assert long.loc["five"]["metric"].to_dict() == METRICS
    assert long.loc["five"]["score"].to_dict() == alone(experiment, "five")


def test_ablations_and_scores_have_them_too(experiment: Experiment) -> None:
    recipes = {name: experiment.pool.equal(name) for name in LEVELS}
    table = scored(experiment, recipes).rename(columns=lambda name: name.removesuffix(" *"))
    for name in LEVELS:
        assert table.loc[name, list(METRICS)].to_dict() == alone(experiment, name)
    long = experiment.scores(recipes)
    assert dict(zip(long["benchmark"], long["metric"], strict=True)) == METRICS
    one = experiment.changed(own_metrics=False)
    assert set(one.scores(recipes)["metric"]) == {"bad-1.0"}
    assert {one.metric_of(column) for column in one.columns} == {"bad-1.0"}


def test_percent_and_pixels_have_no_mean(experiment: Experiment) -> None:
    guide, road, _ = experiment.columns
    mixed = experiment.changed(reported=(road, benchmark("far", (3.0,), metric="epe")))
    assert math.isnan(scored(mixed, {"five": mixed.pool.equal("five")}).loc["five", MEAN])
    assert guide.metric == "bad-1.0"
