"""Which engine runs, what is refused at the door, and what belongs to an evaluation's key."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import torch
from engines_world import Trapped, alone, noise, trapped_pool, trapped_spec

from sfkit.architectures import register_architecture
from sfkit.architectures.registry import _REGISTRY
from sfkit.checkpoints.fingerprints import text_digest
from sfkit.checkpoints.spec import PoolSpec
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError
from sfkit.evaluation import Compute, Evaluator, estimate
from sfkit.evaluation.engines import auto, make_engine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.plan import WorkerPlan, fair_threads
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.metrics import Quantities
from sfkit.evaluation.store import evaluation_key
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.forward import ForwardMode


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return trapped_pool(tmp_path_factory.mktemp("world") / "pool", sources=3)


@pytest.fixture
def homeless() -> Iterator[str]:
    """An architecture as a notebook cell registers one; its name."""

    def cell(*, traps: str = "") -> torch.nn.Module:
        return Trapped(traps=traps)

    cell.__module__ = "__main__"
    register_architecture("homeless", blocks={"level": ["level"]}, version="1")(cell)
    yield "homeless"
    del _REGISTRY["homeless"]


# What is refused, before images are loaded and without a process started.


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"engine": "dask"}, "unknown engine 'dask', expected one of: auto, inline, processes, ray"),
        ({"engine": "processes", "workers": 0}, "workers: found 0, expected at least 1"),
        ({"workers": 2}, "workers: found 2, engine 'inline' has one: choose 'processes' or 'ray'"),
        ({"precision": "half"}, "unknown precision 'half', expected one of: bfloat16, float32"),
    ],
)
def test_an_engine_that_cannot_be_had_is_refused(pool: Pool, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Evaluator(pool, noise(), **options)


def test_ray_is_refused_where_it_is_not_installed(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def without_ray(name: str, package: str | None = None) -> importlib.machinery.ModuleSpec | None:
        return None if name == "ray" else found(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", without_ray)
    with pytest.raises(InputError, match=r"Ray is not installed, install it with pip install 'sfkit\[ray\]'"):
        Evaluator(pool, noise(), engine="ray")


def test_an_architecture_of_a_notebook_cell_needs_a_module_for_workers(tmp_path: Path, homeless: str) -> None:
    spec = trapped_spec(tmp_path / "pool", sources=2)
    local = open_pool(PoolSpec("cell", homeless, spec.base, spec.sources))
    sentence = r"'homeless': found it defined in a notebook cell .* move it to a \.py file and import that"
    with pytest.raises(InputError, match=sentence):
        Evaluator(local, noise(), engine="processes")
    with pytest.raises(InputError, match=sentence):
        WorkerPlan.of(local, noise(), Quantities((1.0,)), mode=ForwardMode(), threads=1)
    evaluator = Evaluator(local, noise(), engine="auto", workers=2)
    assert re.search(f"auto picked inline: .*{sentence}", evaluator.engine.describe())
    assert evaluator([local.equal("a")])[0].error is None


def test_pairs_of_a_class_that_workers_cannot_import_are_refused(pool: Pool) -> None:
    @dataclass(frozen=True)
    class Own:
        id: str
        sample: Sample

        def load(self) -> Sample:
            return self.sample

        def fingerprint(self) -> str:
            return self.id

    pairs = memory_benchmark("own", [Own(pair.id, pair.load()) for pair in noise().pairs])
    engine = Evaluator(pool, pairs, engine="processes", workers=1).engine
    with pytest.raises(
        InputError, match=r"benchmark 'own': cannot be sent to workers .* or use engine='inline'"
    ):
        next(engine.run([pool.uniform()]))
    Own.__module__ = "__main__"
    with pytest.raises(InputError, match="a pair's class: found it defined in a notebook cell"):
        Evaluator(pool, pairs, engine="processes", workers=1)(alone(pool))


def test_a_module_that_is_not_there_is_named(pool: Pool) -> None:
    plan = WorkerPlan.of(pool, noise(), Quantities((1.0,)), mode=ForwardMode(), threads=1)
    lost = type(plan)(**{**vars(plan), "module": "no.such.module"})
    with pytest.raises(InputError, match=r"a worker cannot import no\.such\.module, which registers it"):
        lost.register()


# What auto picks.


class Recorded:
    """Stands in for worker processes: remembers what it was asked to run, and runs it here."""

    name, workers = "processes", 4

    def __init__(self, pool: Pool, benchmark: Any, compute: Compute) -> None:
        self.compute, self.calls = compute, 0
        self.inside = InlineEngine(pool, benchmark)

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        self.calls += 1
        return self.inside.run(recipes)

    def start(self) -> None:
        self.inside.start()

    def describe(self) -> str:
        return "processes: recorded"

    def close(self) -> None:
        self.inside.close()


def automatic(pool: Pool, monkeypatch: pytest.MonkeyPatch, gpus: int, **options: Any) -> auto.AutoEngine:
    monkeypatch.setattr("torch.cuda.device_count", lambda: gpus)
    monkeypatch.setattr(auto, "process_engine", Recorded)
    engine = auto.AutoEngine(pool, Evaluator(pool, noise()).prepared, Compute(engine="auto", **options))
    engine._inline.compute = Compute()  # no GPU is there to run on
    return engine


@pytest.mark.parametrize("options", [{"device": "cpu"}, {"device": "cuda:1"}, {"device": "cuda"}])
def test_auto_stays_inline_on_one_device(
    pool: Pool, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]
) -> None:
    engine = automatic(pool, monkeypatch, 4 if options["device"] == "cuda:1" else 1, **options)
    assert len(list(engine.run(alone(pool) * 5))) == 20
    assert isinstance(engine.picked, InlineEngine)
    said = engine.describe()
    assert said.startswith("auto picked inline: one evaluation at a time on cpu, ")
    one = "the CPU" if options["device"] == "cpu" else "one GPU"
    assert said.endswith(f"({one} is one device: name workers to run several evaluations at a time on it)")


def test_auto_starts_workers_on_several_gpus_once_there_is_work_for_them(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = automatic(pool, monkeypatch, 2, device="cuda")
    assert "2 GPUs: their workers start with the first 4 recipes" in engine.describe()
    list(engine.run(alone(pool)[:3]))
    assert isinstance(engine.picked, InlineEngine), "few evaluations do not pay for a start"
    list(engine.run(alone(pool)))
    assert isinstance(engine.picked, Recorded)
    assert engine.picked.compute == Compute("cuda", "auto")
    list(engine.run(alone(pool)[:1]))
    assert engine.picked.calls == 2, "workers that run are used"
    assert engine.describe().startswith("auto picked processes: recorded (2 GPUs")
    assert engine.workers == 4


def test_auto_starts_as_many_workers_as_are_asked_for(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = automatic(pool, monkeypatch, 0, workers=3)
    assert "3 workers were asked for: they start with the first recipe" in engine.describe()
    list(engine.run(alone(pool)[:1]))
    assert isinstance(engine.picked, Recorded)
    assert engine.picked.compute.workers == 3


@pytest.mark.parametrize(
    ("name", "workers", "said"),
    [
        ("inline", None, r"inline: one evaluation at a time on cpu, \d+ threads?"),
        ("processes", 1, r"processes: 1 worker on cpu, \d+ threads? each"),
        ("processes", 3, r"processes: 3 workers on cpu, \d+ threads? each"),
    ],
)
def test_engines_say_what_they_run_on_and_start_nothing_for_it(
    pool: Pool, name: str, workers: int | None, said: str
) -> None:
    engine = make_engine(pool, Evaluator(pool, noise()).prepared, Compute(engine=name, workers=workers))
    assert engine.workers == (workers or 1)
    assert re.fullmatch(said, engine.describe())
    assert list(engine.run([])) == []
    engine.close()


def test_threads_are_shared_out_fairly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "get_num_threads", lambda: 8)
    assert [fair_threads(workers) for workers in (1, 2, 3, 8, 20)] == [8, 4, 2, 1, 1]


def test_an_estimate_counts_the_workers(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    evaluator = Evaluator(pool, noise())
    alone_ = estimate(evaluator, pool.uniform(), 60)
    evaluator._runner._engine = automatic(pool, monkeypatch, 0, workers=4)
    list(evaluator.engine.run([pool.uniform()]))
    shared = estimate(evaluator, pool.uniform(), 60)
    assert shared.minutes == alone_.minutes / 4
    assert "s each and 4 at a time: " in str(shared)
    assert "at a time" not in str(alone_)


# Keys.


def test_the_key_of_plain_float32_is_what_it_always_was(pool: Pool) -> None:
    evaluator = Evaluator(pool, noise(), engine="auto", workers=2)
    description = {
        "base": pool.base.fingerprint,
        "architecture": pool.describe(),
        "benchmark": noise().fingerprint(),
        "protocol": "all-valid",
        "family": "pairs",
        "resolution": None,
        "precision": "float32",
        "device": "cpu",
        "recipe": pool.canonical(pool.uniform()),
    }
    assert evaluator.describe(pool.uniform()) == description
    frozen = {**description, "base": "b", "architecture": "a", "benchmark": "c", "recipe": "r"}
    written = (
        '{"architecture":"a","base":"b","benchmark":"c","device":"cpu","family":"pairs",'
        '"precision":"float32","protocol":"all-valid","recipe":"r","resolution":null}'
    )
    assert evaluation_key(frozen) == text_digest(written)


def test_precision_and_layout_have_keys_of_their_own(pool: Pool) -> None:
    modes = [{}, {"precision": "bfloat16"}, {"channels_last": True}]
    modes.append({"precision": "bfloat16", "channels_last": True})
    frames = [Evaluator(pool, noise(), **mode).describe(pool.uniform()) for mode in modes]
    assert len({evaluation_key(frame) for frame in frames}) == 4
    extra = [{k: v for k, v in frame.items() if frames[0].get(k) != v} for frame in frames]
    assert extra == modes


def test_precision_and_layout_reach_the_network(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[bool, bool]] = []

    def forward(self: Trapped, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        last = left.is_contiguous(memory_format=torch.channels_last)
        seen.append((torch.is_autocast_enabled("cpu"), last and not left.is_contiguous()))
        return self.level + left.mean(1)

    monkeypatch.setattr(Trapped, "forward", forward)
    for mode in ({}, {"precision": "bfloat16"}, {"channels_last": True}):
        Evaluator(pool, noise(1), **mode)([pool.uniform()])
    assert seen == [(False, False), (True, False), (False, True)]
