"""Whether a search was worth its price, on networks of one level, whose scores are known by hand."""

from __future__ import annotations

import pytest
from flat_world import benchmark, flat_spec

from sfkit import Evaluator, InputError, open_pool
from sfkit.analysis import compare_methods, method_costs, worth
from sfkit.baselines import BaselineRun, run_baselines

METHODS = ("single_best", "single_best_oracle", "uniform", "stage1")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[BaselineRun, list[Evaluator]]:
    """Sources of 1, 5 and 10 px; {one, five} has 3, which is what guides; the test has 5."""
    levels = {"one": 1.0, "five": 5.0, "ten": 10.0}
    pool = open_pool(flat_spec(tmp_path_factory.mktemp("pool"), levels, base=4.5))
    guide = benchmark("guide", tuple(3.0 + n / 100 for n in range(6)), metric="epe")
    test = benchmark("test", tuple(5.0 + n / 100 for n in range(6, 12)), metric="epe")
    evaluators = [Evaluator(pool, one) for one in (guide, test)]
    run = run_baselines(pool, evaluators[0], METHODS, population=16, generations=2, tests=evaluators)
    return run, evaluators


def test_the_answer_counts_deployable_methods_on_what_guided_nothing(
    world: tuple[BaselineRun, list[Evaluator]],
) -> None:
    run, evaluators = world
    found = compare_methods(run, evaluators, validation=["guide"], reference="Stage 1")
    assert found.row("uniform").unseen == pytest.approx(16 / 3 - 5.085, abs=1e-5)
    title, *rest = worth(run, found)
    assert title == (
        "Stage 1 comes 3rd of 3 on what none of them was tuned on: better than 0 methods, worse than 2, "
        "not told apart from 0."
    )
    assert rest[0] == "Stage 1 is worse than single best (validation), uniform."
    took = run.results["stage1"].evaluations
    assert rest[-1] == f"It took {took} evaluations; uniform, which nothing here shows to be worse, took 1."


def test_without_a_test_it_says_so(world: tuple[BaselineRun, list[Evaluator]]) -> None:
    run, evaluators = world
    found = compare_methods(run, evaluators[:1], validation=["guide"], reference="Stage 1")
    assert worth(run, found)[0].startswith("Stage 1 comes 1st of 3 on the pairs it was tuned on, which is no")
    with pytest.raises(InputError, match="expected a benchmark and 'Stage 1\\+2' among the methods"):
        compare_methods(run, evaluators, validation=["guide"])


def test_costs_are_a_record_a_method(world: tuple[BaselineRun, list[Evaluator]]) -> None:
    costs = {cost.method: cost for cost in method_costs(world[0])}
    assert (costs["uniform"].evaluations, costs["uniform"].image_passes) == (1, 6)
