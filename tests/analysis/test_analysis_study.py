"""The main comparison and its summary, on networks of one level, whose scores are known by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from flat_world import benchmark, flat_spec

from sfkit import EvaluationStore, InputError, Recipe, open_pool
from sfkit.analysis import (
    Experiment,
    Study,
    Support,
    environment,
    open_joint,
    recipe_table,
    study,
    study_against_joint,
    summary,
)
from sfkit.analysis.worth import compare_methods
from sfkit.baselines import run_baselines
from sfkit.editing import mark_hand_edit

LEVELS = {"one": 1.0, "five": 5.0, "ten": 10.0}
METHODS = ("single_best", "single_best_oracle", "uniform", "stage1", "stage1_2")


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Equal weights: {one, five} is 3, nearest to what guides; {one, ten} 5.5, {five, ten} 7.5, all 5.33."""
    return Experiment(
        pool=open_pool(flat_spec(tmp_path_factory.mktemp("pool"), LEVELS, base=4.5)),
        validation=benchmark("guide", tuple(3.1 + n / 100 for n in range(6)), metric="epe"),
        reported=(
            benchmark("near", tuple(2.0 + n / 100 for n in range(12)), metric="epe"),
            benchmark("far", tuple(1.2 + n / 100 for n in range(12)), metric="epe"),
        ),
        store=EvaluationStore(":memory:"),
        population=16,
        generations=2,
        evaluations=20,
    )


@pytest.fixture(scope="module")
def found(experiment: Experiment) -> Study:
    return study(experiment, seeds=2, methods=METHODS)


def test_rows_are_the_base_and_the_methods_and_seeds_are_one_row(found: Study) -> None:
    table = found.table()
    assert list(table.index) == [
        *("base", "single best (validation)", "single best (oracle) †", "uniform", "Stage 1", "Stage 1+2")
    ]
    assert list(found.runs)[-4:] == [f"Stage {s}, seed {n}" for s in ("1", "1+2") for n in (0, 1)]
    differences = found.differences_table()
    assert list(differences.index) == list(table.index)
    assert differences["seeds ± (px)"].notna().tolist() == [False] * 4 + [True] * 2
    assert differences.loc["Stage 1", "seeds ± (px)"] == 0.0


def test_scores_and_means_are_those_of_hand(found: Study) -> None:
    table = found.table()
    guide, near, far = table.columns[:3]
    assert [guide.endswith("*"), near.endswith("*"), far.endswith("*")] == [True, False, False]
    assert table.loc["base", [guide, near, far]].tolist() == pytest.approx([1.375, 2.445, 3.245], abs=1e-6)
    level = (1 + 5 + 10) / 3
    expected = [level - 3.125, level - 2.055, level - 1.255]
    assert table.loc["uniform", [guide, near, far]].tolist() == pytest.approx(expected, abs=1e-5)
    assert table.loc["Stage 1", guide] == pytest.approx(0.125)
    assert list(table.columns[3:]) == ["mean", "mean of the unseen"]
    assert table.loc["base", "mean of the unseen"] == pytest.approx((2.445 + 3.245) / 2, abs=1e-6)
    assert table.loc["base", "mean"] == pytest.approx((1.375 + 2.445 + 3.245) / 3, abs=1e-6)


def test_tests_overrule_the_network_that_validation_prefers(found: Study) -> None:
    # What guides is 3.1 px, which Stage 2 hits and Stage 1, at 3 px, does not; what nobody saw is lower.
    scores = {name: result.score for name, result in found.runs.items() if not result.oracle}
    assert found.verdict.preferred == min(scores, key=lambda name: scores[name])
    assert found.verdict.preferred.startswith("Stage 1+2")
    assert found.verdict.support is Support.OVERRULED
    assert found.chosen.startswith("Stage 1, seed")
    assert found.result.score == pytest.approx(0.125)
    assert found.pictured == found.chosen
    assert found.chosen == f"Stage 1, seed {found.seed}"


def test_the_averaged_winner_of_each_seed_is_a_method_and_the_verdict_prefers_the_best_of_them(
    experiment: Experiment,
) -> None:
    found = study(
        experiment.changed(resamples=30), seeds=2, methods=["uniform", "stage1_2"], reference="averaged"
    )
    averaged = [f"averaged winner, seed {n}" for n in (0, 1)]
    assert [name for name in found.runs if name.startswith("averaged")] == averaged
    assert found.reference == "averaged winner"
    assert found.verdict.preferred == min(averaged, key=lambda name: found.runs[name].score)
    assert found.verdict.averaged
    costs = {cost.method: cost for cost in found.costs()}
    more = costs["averaged winner"].evaluations - costs["Stage 1+2"].evaluations
    assert more == sum(found.runs[name].settings["winners"] > 1 for name in averaged)
    assert found.experiment.resamples == 30
    one = experiment.changed(resamples=30, validation=benchmark("lone", (3.1,), metric="epe"))
    with pytest.raises(InputError, match="resamples: found one validation pair"):
        study(one, seeds=1)


def test_verdicts_follow_the_intervals(found: Study) -> None:
    table = found.differences_table()
    mean = found.table()["mean of the unseen"]
    for name in ("base", "uniform"):
        row = table.loc[name]
        assert row["low (px)"] - 1e-9 <= row["to Stage 1 (px)"] <= row["high (px)"] + 1e-9
        assert row["to Stage 1 (px)"] == pytest.approx(mean[name] - mean["Stage 1"])
        assert row["verdict"] == "worse"  # all images of a benchmark move alike
    assert table.loc["Stage 1", "verdict"] == "the reference", "the method that is recommended"


def test_all_that_is_said_of_the_unseen_is_one_family_of_comparisons(found: Study) -> None:
    rows = [row.difference for row in found.comparison.rows if row.difference is not None]
    overruled = len(rows)  # Stage 1+2 beside the same methods, which had been looked at before
    assert found.comparison.family == len(found.verdict.p_values) + overruled + len(rows)
    assert found.verdict.family == found.comparison.family
    assert {one.family for one in rows} == {found.comparison.family}
    (said,) = [one for one in summary(found) if one.startswith("There Stage 1 (over 2 seeds) is ")]
    assert f"All {found.comparison.family} comparisons made there are corrected together (Holm)" in said
    for row in found.comparison.rows[1:4]:
        assert said.count(row.network) == 1
    assert "single best (oracle) (which saw the test)" in said


def test_tests_in_pixels_and_in_percent_are_refused_before_anything_runs(experiment: Experiment) -> None:
    mixed = (experiment.reported[0], experiment.reported[1].measured_by(metric="bad-1.0"))
    store = EvaluationStore(":memory:")
    begun: list[str] = []
    with pytest.raises(InputError, match="benchmarks near, far: found metrics in px and %"):
        study(experiment.changed(reported=mixed, store=store), seeds=1, progress=begun.append)
    with pytest.raises(InputError, match="reference: found 'ties', expected one of: uniform"):
        study(experiment, seeds=1, methods=["uniform"], reference="ties", progress=begun.append)
    assert begun == []


def test_the_summary_says_what_the_tables_say(found: Study) -> None:
    said = " ".join(summary(found))
    assert said.startswith(f"**Stage 2 is not supported here: take {found.chosen}.** Stage 1+2, seed ")
    assert (
        "scores lowest on guide (6 pairs), which chose it, but on what guided nothing (near, far) it is"
        in said
    )
    assert "(near, far; 24 images)" in said
    base, mine = found.mean("base"), found.mean(found.chosen)
    assert f"better than base ({mine - base:+.2f} px" in said
    assert "Alone, 1 of the 3 sources are better than the base" in said
    assert "the best of them there is one (EPE 0.6" in said
    own = next(cost for cost in found.costs() if cost.method == "Stage 1")
    assert f"{own.evaluations:,} evaluations, {own.image_passes:,} image pairs" in said
    total = sum(cost.evaluations for cost in found.costs())
    assert f"in 2 runs, and all it was chosen among {total:,} at most" in said
    assert "over 2 seeds" in said


def test_a_gain_on_validation_alone_is_called_what_it_is(experiment: Experiment) -> None:
    far = benchmark("far", tuple(7.0 + n / 100 for n in range(12)), metric="epe")
    apart = experiment.changed(reported=(far,))
    said = " ".join(summary(study(apart, seeds=1, methods=["uniform", "stage1_2"], reference="uniform")))
    assert "Warning: Stage 1+2 is" in said
    assert "it fits the validation images" in said
    own = " ".join(summary(study(apart, seeds=1, methods=["uniform", "stage1_2"], reference="stage1_2")))
    assert "Warning: Stage 1+2 is better than uniform" in own, "also where others stand beside it"


def test_a_benchmark_whose_scores_a_person_saw_while_editing_is_no_test(experiment: Experiment) -> None:
    store = EvaluationStore(":memory:")
    mark_hand_edit(store, "an edit", experiment.reported[0])
    edited = study(experiment.changed(store=store), seeds=1, methods=["uniform", "stage1"])
    assert [one.benchmark for one in edited.unseen] == ["far"]
    table = edited.table()
    assert [name.split()[0] for name in table.columns if name.endswith("*")] == ["guide", "near"]
    assert table.loc["uniform", "mean of the unseen"] == pytest.approx((1 + 5 + 10) / 3 - 1.255, abs=1e-5)
    said = summary(edited)
    assert "on guide (6 pairs), chosen among 2 networks there" in said[0]
    assert said[2].startswith("Warning: near: 1 recipe edited by hand was scored on 12 of its pairs")
    roles = edited.experiment.scores({"base": experiment.pool.base_recipe()}).set_index("benchmark")["role"]
    assert roles.to_dict() == {"guide": "validation", "near": "validation", "far": "reported"}


def test_costs_and_single_sources_have_tables_of_their_own(found: Study) -> None:
    assert found.took is not None
    assert found.took[1] > 0.0, "CPU seconds stand beside those of the wall"
    assert f"{found.took[0]:,.1f} s of wall time" in found.computing
    costs = found.cost_table()
    assert costs.loc["uniform", ["evaluations", "image passes"]].tolist() == [1, 6]
    assert costs.loc["Stage 1", "evaluations"] == 8  # all subsets of two or more, for each of two seeds
    assert costs["runs"].tolist() == [1, 1, 1, 2, 2]
    own = [result.evaluations for result in found.runs.values() if result.label == "Stage 1+2"]
    assert costs.loc["Stage 1+2", ["evaluations", "image passes"]].tolist() == [sum(own), 6 * sum(own)]
    sources = found.sources_table()
    assert list(sources.columns) == ["base", *LEVELS, "uniform"]
    assert sources.loc["guide (all-valid) epe [px] *", "five"] == pytest.approx(1.875)
    assert sources.loc["mean of the unseen", "five"] == pytest.approx((2.945 + 3.745) / 2, abs=1e-6)
    scores = found.scores()
    assert scores.query("benchmark == 'near' and network == 'base'")["score"].item() == pytest.approx(2.445)


def test_what_the_seeds_chose_is_counted(found: Study) -> None:
    table = found.selection().table()
    assert table["chosen [%]"].to_dict() == {"one": 100.0, "five": 100.0, "ten": 0.0}
    assert table.loc["one", "chosen under Stage 1 [%]"] == 100.0


def test_what_cannot_be_compared_is_refused(experiment: Experiment) -> None:
    with pytest.raises(InputError, match="seeds: found 0"):
        study(experiment, seeds=0)
    with pytest.raises(InputError, match="reference: found 'ties', expected one of: uniform"):
        study(experiment, seeds=1, methods=["uniform"], reference="ties")


def test_the_environment_names_every_checkpoint_and_benchmark(experiment: Experiment) -> None:
    facts = environment(experiment)["value"]
    assert facts["source five"] == experiment.pool.sources[1].fingerprint[:12]
    assert facts["benchmark far"].startswith("12 pairs, all-valid, ")


def test_a_recipe_is_a_row_a_block() -> None:
    table = recipe_table(Recipe.equal(["a", "b"], ["neck", "head"]))
    assert table.to_dict("index") == {name: {"a": 0.5, "b": 0.5, "scale": 1.0} for name in ("neck", "head")}


def test_what_draws_is_drawn_as_often_as_the_stages_have_seeds(experiment: Experiment) -> None:
    small = {"dare": {"probabilities": (0.5,)}, "dare_ties": {"probabilities": (0.5,), "lambdas": (1.0,)}}
    methods = ("random_subsets", "dare", "dare_ties", "stage1")
    drawn = study(experiment, seeds=3, methods=methods, settings=small)
    counts = {row.network: row.spread for row in drawn.comparison.rows}
    assert counts.pop("base") is None
    assert {len(spread.values) for spread in counts.values() if spread} == {3}
    assert len([name for name in drawn.runs if name.startswith("DARE, draw")]) == 3
    costs = drawn.cost_table()
    assert costs.loc["DARE", ["runs", "evaluations"]].tolist() == [1, 3], "three draws, counted once"
    # An interval over seeds and images is at least as wide as over images alone.
    one = drawn.comparison.row("DARE").difference
    assert one is not None
    assert one.interval is not None


def test_a_method_that_drew_is_judged_by_all_its_draws(experiment: Experiment) -> None:
    settings = {"dare": {"probabilities": (0.5,), "draws": 2}}
    scorer = experiment.scorer()
    run = run_baselines(experiment.pool, scorer, ["uniform", "dare"], settings=settings)
    row = compare_methods(run, [scorer], validation=["guide"], reference="uniform").row("DARE")
    assert row.spread is not None
    assert len(row.spread.values) == 2
    assert row.guided == pytest.approx(row.spread.mean)


def test_a_network_trained_on_all_data_stands_beside_the_recommended_one(
    found: Study, experiment: Experiment, tmp_path: Path
) -> None:
    spec = flat_spec(tmp_path, {"together": 2.0}, base=4.5)
    training = {"one": 60.0, "five": 90.0, "ten": 30.0}
    joint = open_joint(experiment.pool, spec.sources[0].path, 3600.0, training)
    record = study_against_joint(found, joint, 3600.0, training)
    table = record.table()
    assert list(table.index) == ["joint retraining", "uniform", found.chosen]
    assert record.benchmarks == ("near", "far")
    assert table.loc["joint retraining", "mean (px)"] == pytest.approx((0.055 + 0.745) / 2, abs=1e-5)
    assert table.loc[found.chosen, "mean (px)"] == pytest.approx(found.mean(found.chosen))
    assert table.loc["uniform", "of joint retraining (%)"] == pytest.approx(2.5)
    assert table.loc[found.chosen, "wall seconds"] == pytest.approx(90.0 + found.result.seconds)
    with pytest.raises(InputError, match="joint: found no seconds of any fine-tuning"):
        open_joint(experiment.pool, spec.sources[0].path, 3600.0, {})
    with pytest.raises(InputError, match="joint: found None seconds of its training, expected"):
        open_joint(experiment.pool, spec.sources[0].path, None, training)
    with pytest.raises(InputError, match=r"nothing\.pth"):
        open_joint(experiment.pool, tmp_path / "nothing.pth", 3600.0, training)
