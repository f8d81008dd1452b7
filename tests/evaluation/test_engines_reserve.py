"""Worker processes serve one plan after the other, where nothing of the last can show in the next."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from engines_world import noise, trapped_pool

from sfkit import Evaluator, open_benchmark, open_pool
from sfkit.evaluation.engines import reserve
from sfkit.evaluation.engines.crew import ParallelEngine, Task
from sfkit.evaluation.engines.processes import ProcessCrew, ProcessSeat, leave
from sfkit.evaluation.engines.schedule import ImageRange
from sfkit.evaluation.store import Evaluation


@pytest.fixture(autouse=True)
def empty() -> Iterator[None]:
    reserve.clear()
    yield
    reserve.clear()


def crew(evaluator: Evaluator) -> ProcessCrew:
    assert isinstance(evaluator.engine, ParallelEngine)
    found = evaluator.engine._crew
    assert isinstance(found, ProcessCrew)
    return found


def pids(evaluator: Evaluator) -> tuple[int, ...]:
    return tuple(seat.process.pid for seat in crew(evaluator)._taken)


def evaluated(pairs: int) -> tuple[tuple[int, ...], Evaluation]:
    pool = open_pool("bank")
    benchmark = open_benchmark("bank:courtyard").first(pairs)
    with Evaluator(pool, benchmark, engine="processes", workers=1) as evaluator:
        (found,) = evaluator.evaluate([pool.uniform()])
        return pids(evaluator), found


def test_the_next_evaluator_takes_the_worker_of_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    (first,), one = evaluated(1)
    (second,), two = evaluated(2)
    assert second == first
    assert two.images[:1] == one.images
    assert len(two.images) == 2
    os.kill(first, signal.SIGKILL)
    (third,), again = evaluated(1)
    assert third != first, "one that was killed while it waited is replaced"
    assert again.images == one.images
    monkeypatch.setenv("SFKIT_ANYTHING", "else")
    pool, benchmark = open_pool("bank"), open_benchmark("bank:courtyard").first(1)
    with Evaluator(pool, benchmark, engine="processes", workers=1) as evaluator:
        evaluator.evaluate([pool.base_recipe()])
        (fourth,) = pids(evaluator)
        assert fourth != third
        assert not Path(f"/proc/{third}").exists(), "a worker of other surroundings has ended"
        crew(evaluator).give(0, Task(2, ImageRange(0, 0, 1), pool.uniform()))
    assert not reserve._waiting
    assert not Path(f"/proc/{fourth}").exists(), "a busy worker ends with its evaluator"


class Waiter:
    """A process that would wait for a plan."""

    owner, running = os.getpid(), True

    def __init__(self) -> None:
        self.told: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *_: self.told.append(name)


def test_a_crew_that_is_collected_while_the_reserve_is_at_work_does_not_wait_for_it(tmp_path: Path) -> None:
    """As by Python's collector, which runs in whatever thread makes an object."""
    seat = ProcessSeat("cpu", ready=True)
    seat.surroundings, seat.process = reserve.Surroundings.here(1, tmp_path), Waiter()  # type: ignore[assignment]
    with reserve._lock:
        leave([seat], kept=True)
    assert not reserve._waiting
    assert seat.process.told == ["release", "terminate", "ended"]  # type: ignore[attr-defined]
    leave([seat], kept=True)
    assert [process for _, process in reserve._waiting] == [seat.process]


def test_a_worker_that_ran_a_users_code_does_not_stay(tmp_path: Path) -> None:
    pool = trapped_pool(tmp_path / "pool")
    with Evaluator(pool, noise(), engine="processes", workers=1) as evaluator:
        evaluator.evaluate([pool.base_recipe()])
        (pid,) = pids(evaluator)
    assert not reserve._waiting
    assert not Path(f"/proc/{pid}").exists()
