"""Ray: two nodes on this machine evaluate as one process does, and survive the death of a worker."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tiny
import torch
from clusters import LEAVES_TO_THE_COLLECTOR, two_nodes
from engines_world import alone, heard, noise, set_wait, trapped_pool

from sfkit.datasets.benchmark import open_benchmark
from sfkit.evaluation import Evaluator
from sfkit.merging import open_pool

pytestmark = [pytest.mark.slow, *LEAVES_TO_THE_COLLECTOR]
END_SECONDS = 120


@pytest.fixture(scope="module")
def ray() -> Iterator[Any]:
    """Ray, connected to a cluster of two nodes with one CPU each."""
    with two_nodes() as cluster:
        import ray

        ray.init(address=cluster.address, log_to_driver=False, logging_level="error")
        yield ray
        ray.shutdown()


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Actors have one thread each."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def test_two_nodes_give_the_bits_of_one_process(ray: Any, tmp_path: Path) -> None:
    pool = open_pool(tiny.write_pool(tmp_path / "pool"))
    pairs = open_benchmark("pairs", tiny.write_pairs(tmp_path / "pairs", count=5))
    expected = heard(Evaluator(pool, pairs), alone(pool))
    with Evaluator(pool, pairs, engine="ray") as evaluator:
        assert evaluator.engine.describe() == "ray: as many workers on cpu as the cluster has room for"
        for folder in ("pool", "pairs"):
            (tmp_path / folder).rename(tmp_path / f"{folder} that no worker can see")
        assert heard(evaluator, alone(pool)) == expected
        assert evaluator.engine.workers == 2, "one a CPU of the cluster"
        assert len(nodes_of(ray, evaluator)) == 2, "spread over both nodes"
    assert ray.is_initialized(), "it was not ours to shut down"


def test_dead_workers_cost_nothing_but_the_candidate_that_kills_them(ray: Any, tmp_path: Path) -> None:
    pool = trapped_pool(tmp_path / "pool", sources=4)
    traps = tmp_path / "pool" / "traps"
    expected = heard(Evaluator(pool, noise()), alone(pool))
    pipe = set_wait(traps, "2")
    (traps / "kill-1").touch()
    killed: list[int] = []

    def kill() -> None:
        killed.append(int(pipe.read_text()))
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    with Evaluator(pool, noise(), engine="ray", workers=2) as evaluator:
        found = heard(evaluator, alone(pool))
    killer.join(END_SECONDS)
    assert killed
    assert found[1:] == expected[1:]
    assert found[0]["failure"].startswith("WorkerDied: 3 workers in a row died over it, the last ended: ")


def nodes_of(ray: Any, evaluator: Evaluator) -> set[str]:
    """The nodes that an evaluator's workers live on."""
    actors = [seat.actor for seat in evaluator.engine._crew._seats]
    asked = [actor.__ray_call__.remote(lambda _: ray.get_runtime_context().get_node_id()) for actor in actors]
    return set(ray.get(asked))
