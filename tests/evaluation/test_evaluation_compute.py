"""Where networks run: one record, taken by everything that evaluates."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import pytest
import torch
from flat_world import benchmark, flat_pool

from sfkit import Compute, EvaluationStore, Evaluator, InputError, score_recipes
from sfkit.analysis import Experiment, measure_recipes
from sfkit.evaluation.compute import check_device
from sfkit.merging import Pool
from sfkit.merging.forward import ForwardMode


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("pool"))


def test_the_defaults_are_one_process_on_the_cpu() -> None:
    compute = Compute()
    assert (compute.device, compute.kind, compute.mode) == ("cpu", "cpu", ForwardMode())
    assert Compute("cuda:3").kind == "cuda"
    with pytest.raises(FrozenInstanceError):
        compute.device = "cuda"  # type: ignore[misc]  # which is the point


@pytest.mark.parametrize("name", ["gpu", "cpu:0", "cuda:", "cuda:x", ""])
def test_what_is_no_device_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"^device: found {name!r}, expected cpu, cuda, cuda:N or mps$"):
        Compute(name)


def test_a_device_that_is_not_there_is_refused_when_a_network_is_made(pool: Pool) -> None:
    away = Compute("cuda:77")
    with pytest.raises(InputError, match=r"^device: cuda:77 is not there, found \d+ CUDA devices; use cpu$"):
        away.model(pool)
    evaluator = Evaluator(pool, benchmark(), compute=away)
    with pytest.raises(InputError, match="cuda:77 is not there"):
        evaluator([pool.uniform()])
    assert evaluator.counts.failed == 0, "no candidate is to blame"


def test_keywords_of_an_evaluator_replace_fields_of_the_record(pool: Pool) -> None:
    given = Compute("cuda:1", "auto", 2)
    assert Evaluator(pool, benchmark(), compute=given).compute == given
    changed = Evaluator(pool, benchmark(), compute=given, device="cpu", precision="bfloat16")
    assert changed.compute == Compute("cpu", "auto", 2, "bfloat16")
    with pytest.raises(TypeError, match="devise"):
        Evaluator(pool, benchmark(), devise="cpu")


@pytest.mark.parametrize("fields", [{"precision": "bfloat16"}, {"channels_last": True}])
def test_tables_evaluate_as_they_are_told(pool: Pool, fields: dict[str, Any]) -> None:
    compute, recipes = Compute(**fields), {"low": pool.equal("low")}
    with EvaluationStore(":memory:") as store:
        score_recipes(pool, recipes, [benchmark()], store=store, compute=compute)
        measure_recipes(pool, recipes, [benchmark(metric="epe")], store=store, compute=compute)
        (held,) = store
    assert fields.items() <= held.description.items()


def test_variants_share_an_engine_only_where_they_evaluate_the_same(pool: Pool) -> None:
    first = Evaluator(pool, benchmark())
    assert first.with_splits([[0]]).engine is first.engine
    assert first.with_splits([[0]]).counts is first.counts
    with EvaluationStore(":memory:") as store:
        apart = first.with_store(store)
        assert apart.engine is not first.engine
        assert (apart.counts, apart.store) == (type(first.counts)(), store)


# An experiment's evaluators.


@pytest.fixture
def experiment(pool: Pool, tmp_path: Path) -> Experiment:
    near, far = benchmark("near", (5.0,)), benchmark("far", (8.0,))
    return Experiment(pool, near, (far,), EvaluationStore(":memory:"))


def test_an_experiment_that_moves_to_a_device_evaluates_there(experiment: Experiment) -> None:
    here = experiment.scorer()
    moved = experiment.changed(device="cuda:0")
    assert moved.compute == Compute("cuda:0")
    assert moved.scorer().device == "cuda:0"
    assert experiment.scorer() is here
    assert experiment.changed(compute=Compute("cuda:1"), workers=1).compute == Compute("cuda:1", workers=1)


def test_an_experiment_with_another_metric_has_its_threshold(experiment: Experiment) -> None:
    before = experiment.scorer()
    changed = experiment.changed(metric="bad-2.5")
    assert 2.5 in changed.scorer().quantities.thresholds
    recipes = {"low": experiment.pool.equal("low")}
    assert set(changed.scores(recipes)["metric"]) == {"bad-2.5"}
    assert experiment.scorer() is before
    assert experiment.scorer(also=("epe", "bad-1.0")) is before, "it has these thresholds"


def test_an_experiment_that_draws_otherwise_keeps_its_evaluators(experiment: Experiment) -> None:
    assert experiment.changed(seed=1, population=4).scorer() is experiment.scorer()


def test_a_mac_with_metal_has_mps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    check_device("mps")
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    with pytest.raises(InputError, match="mps is not there"):
        check_device("mps")
