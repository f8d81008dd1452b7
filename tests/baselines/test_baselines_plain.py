"""Single sources, means, soups and subsets, on networks whose scores can be worked out on paper."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import pytest
from flat_world import benchmark, flat_pool

from sfkit import baselines
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator, pivot
from sfkit.merging import Pool
from sfkit.search import RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings

# Levels in pixels, of a base of 5 px: task vectors of -1, 7 and 4 px.
LEVELS = {"a": 4.0, "b": 12.0, "c": 9.0}


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"), LEVELS)


@pytest.fixture(scope="module")
def eights(pool: Pool) -> Evaluator:
    """End-point error of scenes whose true disparity is 8 px."""
    return scored(pool, 8.0)


def scored(pool: Pool, truth: float, name: str = "noise") -> Evaluator:
    scene = benchmark(name, (truth, truth), metric="epe")
    return Evaluator(pool, scene, store=EvaluationStore(":memory:"))


def sources(folder: Path, levels: Mapping[str, float], truth: float) -> tuple[Pool, Evaluator]:
    pool = flat_pool(folder, levels)
    return pool, scored(pool, truth)


def test_the_single_best_is_the_nearest_source(pool: Pool, eights: Evaluator) -> None:
    found = baselines.single_best(pool, eights)
    assert found.recipe == pool.equal("c")
    assert found.score == pytest.approx(1.0)
    assert (found.evaluations, found.image_passes) == (3, 6)
    assert list(found.history["score"]) == pytest.approx([4.0, 4.0, 1.0])
    assert found.tuned_on_validation
    assert not found.oracle


def test_the_oracle_looks_at_the_benchmarks_reported_on(pool: Pool, eights: Evaluator) -> None:
    """On 5 px and on 3 px source a is nearest, whatever validation says."""
    tests = [scored(pool, 5.0, "far"), scored(pool, 3.0, "farther")]
    found = baselines.single_best_oracle(pool, eights, tests=tests)
    assert found.settings == {"source": "a"}
    assert found.oracle
    assert "2 benchmarks" in found.note
    with pytest.raises(InputError, match="expected evaluators of the report's benchmarks"):
        baselines.single_best_oracle(pool, eights)


def test_the_uniform_merge_is_the_mean(pool: Pool, eights: Evaluator) -> None:
    assert baselines.uniform(pool, eights).score == pytest.approx((4 + 12 + 9) / 3 - 8, abs=1e-6)


def test_task_arithmetic_finds_the_lambda(pool: Pool, eights: Evaluator) -> None:
    """5 + lambda * (-1 + 7 + 4) is 8 at lambda = 0.3; 1/E is in the grid."""
    found = baselines.task_arithmetic(pool, eights)
    assert found.settings == {"lambda": 0.3}
    assert found.score == pytest.approx(0.0, abs=1e-6)
    assert 1 / 3 in set(found.history["lambda"])
    assert found.evaluations == 21
    assert found.score <= baselines.uniform(pool, eights).score


@pytest.mark.parametrize("truth", [2.0, 4.0, 7.0, 8.3])
def test_tuned_task_arithmetic_is_never_worse_than_uniform(pool: Pool, truth: float) -> None:
    validation = scored(pool, truth)
    tuned = baselines.task_arithmetic(pool, validation, lambdas=(0.05, 1.0))
    assert tuned.score <= baselines.uniform(pool, validation).score


def test_a_soup_takes_in_what_helps(tmp_path: Path) -> None:
    """From c (9 px, off by 1) with d (7.5 px): 8.25 px, off by 0.25; with b: 9.5 px, off by 1.5."""
    pool, validation = sources(tmp_path, {"b": 12.0, "c": 9.0, "d": 7.5}, 8.0)
    found = baselines.greedy_soup(pool, validation)
    assert found.settings == {"subset": ("c", "d")}
    assert found.score == pytest.approx(0.25)
    assert found.evaluations == 5


def test_a_tie_is_kept_as_the_paper_says_and_dropped_as_the_code_does(tmp_path: Path) -> None:
    """6 px is off by 2; with 14 px the mean is 10 px, off by 2 as well."""
    pool, validation = sources(tmp_path, {"a": 6.0, "b": 14.0}, 8.0)
    assert baselines.greedy_soup(pool, validation).settings == {"subset": ("a", "b")}
    assert baselines.greedy_soup_strict(pool, validation).settings == {"subset": ("a",)}


def test_exhaustive_search_scores_every_subset(tmp_path: Path) -> None:
    levels = {"a": 6.0, "b": 10.5, "c": 9.0, "d": 2.0}
    pool, validation = sources(tmp_path, levels, 8.0)
    found = baselines.exhaustive(pool, validation)
    subsets = [c for size in (2, 3, 4) for c in combinations(levels, size)]
    errors = {c: abs(sum(levels[name] for name in c) / len(c) - 8) for c in subsets}
    assert found.settings["subset"] == min(errors, key=errors.__getitem__)
    assert found.score == pytest.approx(min(errors.values()), abs=1e-6)
    assert found.evaluations == len(subsets) == 11
    with pytest.raises(InputError, match="4 sources have 11 subsets, expected at most 10"):
        baselines.exhaustive(pool, validation, most=10)


def test_random_subsets_differ_and_keep_to_their_budget(tmp_path: Path) -> None:
    pool, validation = sources(tmp_path, {"a": 6.0, "b": 10.5, "c": 9.0, "d": 2.0}, 8.0)
    few = baselines.random_subsets(pool, validation, budget=4, seed=1)
    assert few.evaluations == few.history["subset"].nunique() == 4
    again = baselines.random_subsets(pool, validation, budget=4, seed=1)
    assert list(again.history["subset"]) == list(few.history["subset"])
    everything = baselines.random_subsets(pool, validation, budget=50)
    assert everything.evaluations == 11
    assert everything.score == baselines.exhaustive(pool, validation).score


def test_both_stages_are_entries_like_the_others(pool: Pool, eights: Evaluator) -> None:
    run = baselines.run_baselines(
        pool, eights, ["random_subsets", "stage1_2", "stage1"], population=4, generations=3, evaluations=12
    )
    assert list(run.results) == ["random_subsets", "stage1_2", "stage1"]
    assert run.results["stage1_2"].score <= run.results["stage1"].score
    assert run.results["random_subsets"].evaluations <= run.results["stage1"].evaluations
    assert run.results["stage1_2"].evaluations > run.results["stage1"].evaluations
    assert set(run.results["stage1_2"].history["stage"]) == {"Stage 1", "Stage 2"}


def test_the_stages_take_all_their_settings(pool: Pool, eights: Evaluator) -> None:
    """As the searches themselves do, which know nothing of methods."""
    which = SubsetSettings(population=4, generations=2, crossover=0.1, mutation=0.9, seed=3)
    how = RoutingSettings(evaluations=9, sigma=0.2, gamma=(0.5, 1.5), tied=False, seed=5)
    first = SubsetSearch(pool.names, pool.blocks, eights, which)
    subset = first.run().subset
    second = RoutingSearch(subset, pool.blocks, eights, how)
    found = baselines.stage1_2(pool, eights, population=50, evaluations=300, which=which, how=how)
    assert found.recipe == second.run().recipe
    assert (
        found.settings["subset"] == baselines.stage1(pool, eights, which=which).settings["subset"] == subset
    )
    drawn = found.history[found.history["stage"] == "Stage 2"]
    assert drawn["score"].tolist() == second.history["score"].tolist()
    with pytest.raises(InputError, match=r"resamples: found shrinkage 0\.1"):
        baselines.averaged(pool, eights, how=RoutingSettings(shrinkage=0.1))


def test_what_does_not_suit_is_skipped_with_its_reason_unless_it_was_named(
    pool: Pool, eights: Evaluator
) -> None:
    small = {"population": 4, "generations": 1, "evaluations": 4}
    run = baselines.run_baselines(pool, eights, **small)  # type: ignore[arg-type]
    assert "tests" in run.skipped["single_best_oracle"]
    assert "exhaustive" not in run.results
    assert set(run.results) | set(run.skipped) | {"exhaustive", "averaged"} == set(baselines.baselines())
    with pytest.raises(InputError, match="found no tests"):
        baselines.run_baselines(pool, eights, ["single_best_oracle"])
    with pytest.raises(InputError, match="did you mean 'uniform'"):
        baselines.run_baselines(pool, eights, ["unifrom"])
    with pytest.raises(InputError, match="setting of baseline 'task_arithmetic'"):
        baselines.run_baselines(pool, eights, settings={"task_arithmetic": {"lambda": (1.0,)}})


def test_tables_say_what_was_chosen_and_what_it_cost(pool: Pool, eights: Evaluator) -> None:
    run = baselines.run_baselines(pool, eights, ["uniform", "task_arithmetic"])
    table = baselines.baseline_table(run)
    assert table.loc["task arithmetic", "chosen"] == "lambda=0.3"
    assert table.loc["task arithmetic", "evaluations"] == 21
    scores = baselines.score_baselines(run, [eights, scored(pool, 9.0, "near")], validation=["noise"])
    wide = pivot(scores)
    assert wide.loc["task arithmetic", "near (all-valid) epe [px]"] == pytest.approx(1.0, abs=1e-5)
    assert wide.loc["uniform", "noise (all-valid) epe [px] *"] == pytest.approx(1 / 3, abs=1e-5)


def test_every_method_says_where_it_comes_from_and_what_it_sees() -> None:
    listed = baselines.catalogue()
    assert list(listed.index) == list(baselines.baselines())
    assert listed["what"].str.endswith(".").all()
    assert listed["label"].is_unique
    assert list(listed.index[listed["sees"] != "validation"]) == ["single_best_oracle"]
