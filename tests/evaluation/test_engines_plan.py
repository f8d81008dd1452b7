"""What makes a worker elsewhere: plans, parcels, settings, and the parts a worker evaluates."""

from __future__ import annotations

import importlib.util
import pickle
from dataclasses import replace
from pathlib import Path

import pytest
import tiny
import torch
from engines_world import alone, heard, noise, trapped_pool

from sfkit.datasets.benchmark import open_benchmark
from sfkit.evaluation import Evaluator
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.plan import Numerics, WorkerPlan
from sfkit.evaluation.engines.shared_pool import SharedPool, TensorBytes, in_memory
from sfkit.evaluation.engines.worker import DeviceLostError
from sfkit.evaluation.metrics import Quantities
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.forward import ForwardMode


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return trapped_pool(tmp_path_factory.mktemp("world") / "pool", sources=3)


def test_parts_of_a_recipe_in_a_row_merge_it_once(pool: Pool) -> None:
    worker = InlineEngine(pool, Evaluator(pool, noise(4)).prepared).worker
    whole = worker.run(pool.equal("a"))
    applied: list[Recipe] = []
    apply = worker.model.apply

    def counted(recipe: Recipe) -> None:
        applied.append(recipe)
        apply(recipe)

    worker.model.apply = counted  # type: ignore[method-assign]  # the method stays, and is counted
    parts = [worker.part(pool.equal("b"), 0, 3), worker.part(pool.equal("b"), 3, 4)]
    assert applied == [pool.equal("b")]
    again = worker.part(pool.equal("a"), 0, 4)
    assert again.images == whole.images
    assert parts[0].images + parts[1].images == worker.run(pool.equal("b")).images
    apply(pool.equal("c"))  # someone else uses the model
    assert worker.part(pool.equal("b"), 3, 4).images == parts[1].images
    assert applied == [pool.equal(name) for name in "babb"]


def test_a_device_that_answers_no_more_is_no_candidates_fault(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a sticky CUDA error shows itself; this has not been seen on a GPU."""
    worker = InlineEngine(pool, Evaluator(pool, noise(1)).prepared).worker
    worker.model.device = torch.device("cuda")
    monkeypatch.setattr(worker.model, "apply", lambda recipe: None)
    monkeypatch.setattr(worker, "predict", lambda number: 1 / 0)
    monkeypatch.setattr(torch.cuda, "synchronize", lambda device: None)
    assert worker.run(pool.equal("a")).failure == "ZeroDivisionError: division by zero"

    def lost(device: torch.device) -> None:
        raise RuntimeError("CUDA error: an illegal memory access was encountered")

    monkeypatch.setattr(torch.cuda, "synchronize", lost)
    with pytest.raises(DeviceLostError, match=r"^cuda: does not answer after an error \(ZeroDivisionError"):
        worker.run(pool.equal("a"))


def test_a_plan_travels_and_becomes_a_worker(pool: Pool) -> None:
    mode = ForwardMode("bfloat16", channels_last=True)
    plan = WorkerPlan.of(pool, noise(), Quantities((0.5, 1.25)), mode=mode, threads=1)
    worker = pickle.loads(pickle.dumps(plan)).open("cpu")  # noqa: S301  # as multiprocessing sends it
    assert worker.model.mode == mode
    assert worker.benchmark.quantities.thresholds == (0.5, 1.25)
    assert worker.run(pool.uniform()).failure is None


def test_a_plan_that_runs_others_code_leaves_a_trace(pool: Pool) -> None:
    """The user's file, one of their modules, their checkout: none of it is there for the next plan."""
    plan = WorkerPlan.of(pool, noise(), Quantities((1.0,)), mode=ForwardMode(), threads=1)
    assert not plan.leaves_no_trace
    for name, ours in (("anynet", True), ("adapters.standalone", False), ("adapters.installed", False)):
        module = architecture_module(name)
        assert replace(plan, module=module).leaves_no_trace is ours


def architecture_module(name: str) -> str:
    module = f"sfkit.architectures.{name}"
    assert importlib.util.find_spec(module) is not None
    return module


def test_torchs_settings_travel_with_a_plan() -> None:
    before = Numerics.here()
    other = Numerics("high", True, not before.cudnn_tf32, True, True)
    try:
        other.apply()
        assert Numerics.here() == other
    finally:
        before.apply()
    assert Numerics.here() == before


@pytest.mark.parametrize(
    "tensor",
    [
        torch.tensor([1.5, -2.25], dtype=torch.bfloat16),
        torch.arange(12).reshape(3, 4).t(),
        torch.tensor(3.0),
        torch.empty(0, 2),
        torch.tensor([True, False]),
    ],
    ids=["bfloat16", "transposed", "no dimension", "empty", "bool"],
)
def test_any_tensor_survives_as_bytes(tensor: torch.Tensor) -> None:
    back = TensorBytes.of(tensor).tensor()
    assert back.dtype == tensor.dtype
    assert torch.equal(back, tensor)


def test_a_pool_in_a_parcel_merges_to_the_same_bits(pool: Pool) -> None:
    shared = pickle.loads(pickle.dumps(SharedPool.of(pool)))  # noqa: S301  # as Ray sends it
    opened = shared.open()
    assert opened.describe() == pool.describe()
    assert opened.identity == pool.identity
    for recipe in alone(pool):
        assert opened.canonical(recipe) == pool.canonical(recipe)
        merged = [p.merge_into(recipe, torch.empty(p.layout.size)) for p in (opened, pool)]
        assert torch.equal(*merged)


def test_a_benchmark_in_memory_still_knows_the_files_it_came_from(pool: Pool) -> None:
    evaluator = Evaluator(pool, noise())
    held = in_memory(evaluator.prepared)
    assert held.ids == noise().ids
    assert [pair.load() for pair in held.pairs] == list(evaluator.prepared.samples)
    assert held.fingerprint() == in_memory(Evaluator(pool, noise()).prepared).fingerprint()
    assert held.fingerprint() != in_memory(Evaluator(pool, noise(2)).prepared).fingerprint()


def test_a_second_store_has_an_engine_of_its_own(pool: Pool) -> None:
    first = Evaluator(pool, noise())
    first([pool.uniform()])
    second = first.with_store(Evaluator(pool, noise()).store)
    second.release()
    assert second.engine is not first.engine
    assert heard(second, [pool.uniform()]) == heard(first, [pool.uniform()])


def test_another_number_of_threads_moves_errors_by_rounding_only(tmp_path: Path) -> None:
    """The tolerance that the evaluator states: sums of errors agree to 1e-5 of their size."""
    anynet = open_pool(tiny.write_pool(tmp_path / "pool"))
    pairs = open_benchmark("pairs", tiny.write_pairs(tmp_path / "pairs"))
    before, sums = torch.get_num_threads(), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            (evaluation,) = Evaluator(anynet, pairs).evaluate([anynet.uniform()])
            sums.append([image.regions["all"].sum_abs for image in evaluation.images])
    finally:
        torch.set_num_threads(before)
    assert sums[0] == pytest.approx(sums[1], rel=1e-5)
