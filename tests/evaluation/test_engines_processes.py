"""Worker processes: the same bits as inline for any number of them, whatever dies while they work."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import tiny
import torch
from engines_world import alone, heard, noise, set_wait, trapped_pool

from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.errors import InputError, SfkitError
from sfkit.evaluation import Compute, EvaluationStore, Evaluator
from sfkit.evaluation.engines.processes import cores, process_engine, seats_on
from sfkit.evaluation.store import Evaluation
from sfkit.merging import Pool, open_pool
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import search_pool, summary
from sfkit.search.plan import SearchPlan

END_SECONDS = 120  # longer than any process here takes to end; only a broken test waits that long


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Fixed threads: the fair share of one is one, for any number of workers."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    """Four sources of a tiny AnyNet."""
    return open_pool(tiny.write_pool(tmp_path_factory.mktemp("anynet"), sources=4))


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    """Five pairs in files."""
    return open_benchmark("pairs", tiny.write_pairs(tmp_path_factory.mktemp("pairs"), count=5))


def searched(pool: Pool, pairs: Benchmark, folder: Path, engine: str, workers: int) -> dict[str, Any]:
    """Both stages with an engine: what they found, and every evaluation on the way there."""
    plan = SearchPlan(
        stage1=SubsetSettings(population=6, generations=2, seed=3),
        stage2=RoutingSettings(evaluations=9, seed=3),
    )
    store = EvaluationStore(folder / f"{engine}{workers}.sqlite")
    with store, Evaluator(pool, pairs, store=store, engine=engine, workers=workers) as evaluator:
        found = search_pool(pool, evaluator, plan, folder / f"{engine}{workers}")
        evaluations = {e.key: _plain(e) for e in store}
    tables = ("stage1", "stage2")
    stages = {n: pd.read_csv(found.folder / f"{n}.csv", dtype=str, keep_default_na=False) for n in tables}
    return {
        "summary": summary(pool, found),
        "evaluations": evaluations,
        "stages": {n: t.drop(columns=["seconds", "cpu_seconds"]).to_dict("split") for n, t in stages.items()},
    }


def _plain(evaluation: Evaluation) -> tuple[Any, ...]:
    return evaluation.description, [image.to_dict() for image in evaluation.images], evaluation.failure


@pytest.fixture(scope="module")
def inline(pool: Pool, pairs: Benchmark, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a search with the inline engine gives."""
    return searched(pool, pairs, tmp_path_factory.mktemp("inline"), "inline", 1)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_search_gives_the_same_bits_with_any_number_of_workers(
    pool: Pool, pairs: Benchmark, inline: dict[str, Any], tmp_path: Path, workers: int
) -> None:
    found = searched(pool, pairs, tmp_path, "processes", workers)
    assert found["stages"] == inline["stages"]
    assert found["summary"] == inline["summary"]
    assert found["evaluations"] == inline["evaluations"]
    assert len(found["evaluations"]) > 10


def test_cpu_seconds_are_those_of_the_workers(
    pool: Pool, pairs: Benchmark, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Evaluator(pool, pairs, engine="processes", workers=2) as evaluator:
        monkeypatch.setattr(time, "process_time", lambda: 0.0)  # of this process, which only waits
        (found,) = evaluator.evaluate([pool.uniform()])
        assert evaluator([pool.uniform()])[0].cpu_seconds == found.cpu_seconds
    assert found.cpu_seconds is not None
    assert found.cpu_seconds > 0.0


class Trapped:
    """A pool with traps, an inline evaluator, and one with two worker processes."""

    def __init__(self, folder: Path) -> None:
        self.pool = trapped_pool(folder, sources=4)
        self.traps = folder / "traps"
        self.inline = Evaluator(self.pool, noise())
        self.processes = Evaluator(self.pool, noise(), engine="processes", workers=2)


@pytest.fixture(scope="module")
def trapped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trapped]:
    world = Trapped(tmp_path_factory.mktemp("world") / "pool")
    with world.processes:
        yield world


def fresh(evaluator: Evaluator) -> Evaluator:
    """The evaluator with nothing in its store; its workers stay."""
    evaluator.store = EvaluationStore(":memory:")
    return evaluator


def test_a_worker_killed_amid_an_evaluation_costs_nothing(trapped: Trapped) -> None:
    recipes = alone(trapped.pool)
    expected = heard(fresh(trapped.inline), recipes)
    pipe = set_wait(trapped.traps, "2")
    killed: list[int] = []

    def kill() -> None:
        killed.append(int(pipe.read_text()))  # read when a worker is in the midst of source b
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    assert heard(fresh(trapped.processes), recipes) == expected
    killer.join(END_SECONDS)
    assert killed
    assert trapped.processes.counts.failed == 0


def test_a_candidate_that_kills_every_worker_fails_after_three_and_the_others_finish(
    trapped: Trapped,
) -> None:
    (trapped.traps / "raise-8").touch()
    recipes = alone(trapped.pool)
    expected = heard(fresh(trapped.inline), recipes)
    (trapped.traps / "kill-1").touch()
    found = heard(fresh(trapped.processes), recipes)
    assert found[1:] == expected[1:]
    assert found[3]["failure"] == "RuntimeError: level 8 is not to be", "what raises here raises there"
    assert found[0]["images"] == []
    assert found[0]["failure"] == (
        "WorkerDied: 3 workers in a row died over it, the last was killed by signal 9 (Killed)"
    )
    (trapped.traps / "kill-1").unlink()
    again = heard(trapped.processes, recipes[:1])
    assert again[0]["failure"] == found[0]["failure"], "a failure is tried again on request only"


def test_a_call_given_up_leaves_nothing_behind_in_the_next(trapped: Trapped) -> None:
    """What workers still finish for a call that nobody hears any more is no answer to the next."""
    engine, recipes = trapped.processes.engine, alone(trapped.pool)
    first = engine.run(recipes)
    next(first)
    first.close()
    reversed_ = recipes[::-1]
    found = dict(engine.run(reversed_))
    expected = dict(trapped.inline.engine.run(reversed_))
    assert {n: r.images for n, r in found.items()} == {n: r.images for n, r in expected.items()}


SCRIPT = """
import json, sys, threading
from pathlib import Path
from engines_world import alone, heard, noise, set_wait, trapped_spec
from sfkit.evaluation import Evaluator, EvaluationStore
from sfkit.merging import open_pool

folder = Path(sys.argv[1])
pool = open_pool(trapped_spec(folder))
evaluator = Evaluator(pool, noise(), engine="processes", workers=1)

def work():
    print(json.dumps(heard(evaluator, alone(pool))), flush=True)
    evaluator.store = EvaluationStore(":memory:")
    print(set_wait(folder / "traps", "1"), flush=True)
    evaluator(alone(pool))

threading.Thread(target=work, daemon=True).start()
threading.Event().wait()
"""


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs Linux, to wait for a foreign process")
def test_a_thread_of_a_script_without_a_file_evaluates_and_no_worker_outlives_it(tmp_path: Path) -> None:
    """From standard input there is no main file to import again, as in a notebook."""
    path = os.pathsep.join([*sys.path, str(Path(__file__).parent)])
    script = subprocess.Popen(
        [sys.executable, "-", str(tmp_path / "pool")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert script.stdin is not None
    assert script.stdout is not None
    with script.stdin, script.stdout:
        script.stdin.write(SCRIPT.encode())
        script.stdin.close()
        images = [entry["images"] for entry in json.loads(script.stdout.readline())]
        pool = trapped_pool(tmp_path / "here")
        expected = json.loads(json.dumps(heard(Evaluator(pool, noise()), alone(pool))))
        assert images == [entry["images"] for entry in expected]
        pipe = Path(script.stdout.readline().decode().strip())
        worker = os.pidfd_open(int(pipe.read_text()))  # it is in the midst of an evaluation
        script.kill()
        assert script.wait() == -signal.SIGKILL
        assert select.select([worker], [], [], END_SECONDS)[0] == [worker]
        os.close(worker)


def test_workers_that_never_get_ready_are_given_up(trapped: Trapped) -> None:
    prepared = trapped.inline.prepared
    one = Compute(engine="processes", workers=1)
    engine = process_engine(trapped.pool, prepared, one, start_seconds=0.05)
    with pytest.raises(
        SfkitError, match=r"3 workers in a row on cpu did not get ready, the last was not ready"
    ):
        list(engine.run(alone(trapped.pool)))


def test_a_file_that_changed_since_the_pool_was_opened_is_refused(tmp_path: Path) -> None:
    pool = trapped_pool(tmp_path / "pool")
    evaluator = Evaluator(pool, noise(), engine="processes", workers=1)
    source = tmp_path / "pool" / "b.safetensors"
    source.write_bytes((trapped_pool(tmp_path / "other", sources=5).sources[4].path).read_bytes())
    with pytest.raises(InputError, match=r"b\.safetensors: has changed since pool 'trapped' was opened"):
        evaluator([pool.equal("a")])
    assert evaluator.counts.failed == 0, "no candidate is to blame"


def test_workers_sit_on_the_devices_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 3)
    assert seats_on("cuda", None) == ("cuda:0", "cuda:1", "cuda:2")
    assert seats_on("cuda", 4) == ("cuda:0", "cuda:1", "cuda:2", "cuda:0")
    assert seats_on("cuda:1", None) == ("cuda:1",)
    assert seats_on("cuda:1", 2) == ("cuda:1", "cuda:1")
    assert seats_on("cpu", 3) == ("cpu",) * 3
    assert seats_on("cpu", None) == ("cpu",) * cores()
