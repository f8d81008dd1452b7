"""Each benchmark under its own metric: every table shows what an evaluator of that metric says by itself."""

from __future__ import annotations

import math

import pytest
from flat_world import benchmark, flat_spec

from sfkit import EvaluationStore, Evaluator, Recipe, open_pool
from sfkit.analysis import Experiment, Study, fitness_criteria, stage_variants, study, validation_sets
from sfkit.analysis.ablations import MEAN, scored

LEVELS = {"one": 1.0, "five": 5.0, "ten": 10.0}
METRICS = {"eth3d": "bad-1.0", "kitti2012": "d1", "kitti2015": "d1", "middlebury": "bad-2.0"}
"""The paper's four benchmarks of three metrics; the first guides."""
TRUTHS = {
    "eth3d": (1.5, 6.5),
    "kitti2012": (1.6, 8.0),
    "kitti2015": (5.6, 8.9, 4.4),
    "middlebury": (2.9, 7.4),
}
METHODS = ("single_best", "single_best_oracle", "uniform", "stage1")


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    guide, *reported = (benchmark(n, levels, metric=METRICS[n]) for n, levels in TRUTHS.items())
    return Experiment(
        pool=open_pool(flat_spec(tmp_path_factory.mktemp("pool"), LEVELS, base=4.5)),
        validation=guide,
        reported=tuple(reported),
        store=EvaluationStore(":memory:"),
        population=6,
        generations=1,
        evaluations=8,
    )


@pytest.fixture(scope="module")
def found(experiment: Experiment) -> Study:
    return study(experiment, seeds=1, methods=METHODS)


def alone(experiment: Experiment, recipe: Recipe) -> dict[str, float]:
    """What an evaluator of each benchmark under its own metric, on a store of its own, says of a recipe."""
    return {one.name: Evaluator(experiment.pool, one)([recipe])[0].score for one in experiment.columns}


def by_hand(experiment: Experiment, level: float) -> dict[str, float]:
    """The same from levels and truths, both flat: an image is wrong everywhere or nowhere."""
    limits = {"bad-1.0": lambda truth: 1.0, "bad-2.0": lambda truth: 2.0, "d1": lambda t: max(3.0, 0.05 * t)}
    return {
        name: 100.0 * sum(abs(level - truth) > limits[METRICS[name]](truth) for truth in truths) / len(truths)
        for name, truths in TRUTHS.items()
    }


def means(scores: dict[str, float]) -> dict[str, float]:
    return {
        "mean": sum(scores.values()) / len(scores),
        "mean of the unseen": sum(score for name, score in scores.items() if name != "eth3d") / 3,
    }


def test_the_main_table_has_the_papers_columns_each_under_its_own_metric(
    experiment: Experiment, found: Study
) -> None:
    main = found.table()
    labels = [f"{n} (all-valid) {m} [%]{' *' * (n == 'eth3d')}" for n, m in METRICS.items()]
    assert list(main.columns) == [*labels, "mean", "mean of the unseen"]
    recipes = {"base": experiment.pool.base_recipe()}
    recipes |= {result.label: result.recipe for result in found.runs.values()}
    assert [name.removesuffix(" †") for name in main.index] == list(recipes)
    for name, recipe in recipes.items():
        row = main.loc[f"{name} †" if "oracle" in name else name]
        expected = alone(experiment, recipe)
        assert row[labels].tolist() == [*expected.values()], name
        assert row[["mean", "mean of the unseen"]].to_dict() == pytest.approx(means(expected)), name
    assert alone(experiment, recipes["base"]) == by_hand(experiment, 4.5)


def test_the_oracle_is_the_source_with_the_lowest_mean_of_all_four(
    experiment: Experiment, found: Study
) -> None:
    known = {name: means(by_hand(experiment, level)) for name, level in LEVELS.items()}
    lowest = {mean: min(LEVELS, key=lambda name: known[name][mean]) for mean in known["one"]}
    assert lowest == {"mean": "one", "mean of the unseen": "five"}, "the two means disagree"
    assert found.runs["single best (oracle)"].settings["source"] == "one"
    assert "single best (oracle) †" in found.table().index


def test_the_table_of_sources_is_the_papers(experiment: Experiment, found: Study) -> None:
    sources = found.sources_table()
    assert list(sources.columns) == ["base", *LEVELS, "uniform"]
    assert [label.split()[0] for label in sources.index] == [*METRICS, "mean", "mean"]
    for network, level in {"base": 4.5, **LEVELS, "uniform": sum(LEVELS.values()) / 3}.items():
        expected = by_hand(experiment, level)
        assert sources[network].tolist() == pytest.approx([*expected.values(), *means(expected).values()])


def test_the_table_of_scores_has_every_metric(experiment: Experiment, found: Study) -> None:
    assert found.metric is None, "the columns share none"
    long = found.scores().set_index(["network", "benchmark"])
    assert long.loc["five"]["metric"].to_dict() == METRICS
    assert long.loc["five"]["score"].to_dict() == by_hand(experiment, 5.0)


def test_the_tables_of_stages_sets_and_metrics_have_the_papers_columns(experiment: Experiment) -> None:
    columns = [*METRICS, "mean", "mean of the unseen"]
    stages = stage_variants(experiment, {"Stage 1": None})
    assert [name.removesuffix(" *") for name in stages.columns] == ["subset", *columns]
    sets = validation_sets(experiment, routing=False)
    assert list(sets.columns) == ["subset", *columns, "overlap"]
    criteria = fitness_criteria(experiment, routing=False)
    assert list(criteria.index) == [f"{name} {metric}" for name, metric in METRICS.items()]
    for table in (sets, criteria):
        for (_, row), guide in zip(table.iterrows(), METRICS, strict=True):
            expected = alone(experiment, experiment.pool.equal(*row["subset"].split(", ")))
            assert row[list(METRICS)].to_dict() == expected
            assert row["mean"] == pytest.approx(means(expected)["mean"])
            unseen = [score for name, score in expected.items() if name != guide]
            assert row["mean of the unseen"] == pytest.approx(sum(unseen) / 3)


def test_ablations_and_scores_follow_the_same_metrics(experiment: Experiment) -> None:
    recipes = {name: experiment.pool.equal(name) for name in LEVELS}
    table = scored(experiment, recipes).rename(columns=lambda name: name.removesuffix(" *"))
    for name in LEVELS:
        assert table.loc[name, list(METRICS)].to_dict() == alone(experiment, recipes[name])
    long = experiment.scores(recipes)
    assert dict(zip(long["benchmark"], long["metric"], strict=True)) == METRICS
    one = experiment.changed(metric="bad-1.0")
    assert set(one.scores(recipes)["metric"]) == {"bad-1.0"}
    assert {one.metric_of(column) for column in one.columns} == {"bad-1.0"}


def test_percent_and_pixels_have_no_mean(experiment: Experiment) -> None:
    guide, road, *_ = experiment.columns
    mixed = experiment.changed(reported=(road, benchmark("far", (3.0,), metric="epe")))
    assert math.isnan(scored(mixed, {"five": mixed.pool.equal("five")}).loc["five", MEAN])
    assert guide.metric == "bad-1.0"
