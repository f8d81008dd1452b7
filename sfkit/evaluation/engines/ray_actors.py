"""The ray engine: the same worker as a Ray actor, on as many machines as the cluster has.

Pool and images go into Ray's object store once. Workers of one machine share that memory, and need no
files: only sfkit, and the module of an architecture that is not sfkit's own. It has run on clusters of
CPUs only, on no GPU yet.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.compute import Compute, ensure_ray
from sfkit.evaluation.engines.crew import START_SECONDS, Crew, Death, Finished, ParallelEngine, Seat, Task
from sfkit.evaluation.engines.plan import WorkerPlan
from sfkit.evaluation.engines.shared_pool import SharedPool, in_memory
from sfkit.evaluation.engines.worker import Result, Worker
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True)
class WorkerSetup:
    """What lies in the object store: the plan, the pool it needs, and where modules may be found."""

    plan: WorkerPlan
    pool: SharedPool
    path: tuple[str, ...]
    device: str


class RayWorker:
    """The actor: one worker, opened from an order."""

    def open(self, order: WorkerSetup) -> None:
        """Become a worker; see :meth:`~sfkit.evaluation.engines.plan.WorkerPlan.open`."""
        # What lies in the object store cannot be written to, and torch warns of it.
        warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
        # The module of an architecture is imported by its name, from where the user has it.
        sys.path.extend(entry for entry in order.path if entry not in sys.path)
        order.plan.register()
        self._worker: Worker = order.plan.open(order.device, order.pool.open())

    def part(self, recipe: Recipe, start: int, stop: int) -> Result:
        """Evaluate one recipe on images ``start..stop``."""
        return self._worker.part(recipe, start, stop)


@dataclass(eq=False)
class RaySeat(Seat):
    """A seat, the actor that works there now, and what it was last asked for (None while it waits)."""

    actor: Any = None
    pending: Any = None


class RayCrew(Crew[RaySeat]):
    """Actors on a Ray cluster; connects to the one there is, or starts one on this machine.

    Args:
        order: what every worker becomes.
        workers: how many; one a GPU or a CPU of the cluster where None.
        start_seconds: how long a worker may take to get ready.

    Raises:
        SfkitError: no cluster can be reached, and none started here.
    """

    def __init__(self, order: WorkerSetup, workers: int | None, start_seconds: float) -> None:
        import ray

        super().__init__(start_seconds)
        self._ray: Any = ray
        # A cluster that the user joined stays joined when this crew goes.
        self._owns_ray = not ray.is_initialized()
        if self._owns_ray:
            connect(ray)
        self._gpus = 1 if order.device == "cuda" else 0
        # Once for all actors: a machine has one copy, however many workers.
        self._order = ray.put(order)
        self._seats = [RaySeat() for _ in range(workers or self._places())]
        for seat in self._seats:
            self._occupy(seat)

    def give(self, number: int, task: Task) -> None:
        """Give a free seat a task."""
        seat = self._seats[number]
        seat.task = task
        seat.pending = seat.actor.part.remote(task.recipe, task.part.start, task.part.stop)

    def events(self) -> Iterator[Finished | Death]:
        """Wait until something happens: an answer, an end, a worker that is ready, or one that hangs."""
        pending = {seat.pending: seat for seat in self._seats if seat.pending is not None}
        done, _ = self._ray.wait(list(pending), num_returns=1, timeout=self._patience())
        for reference in done:
            yield from self._listen(pending[reference])
        for seat in self._late():
            need = "GPU" if self._gpus else "CPU"
            how = f"was not ready after {self._start_seconds:g} s, is a {need} free for it?"
            yield from self._bury(seat, how)

    def close(self) -> None:
        """End all workers, and Ray where this crew started it."""
        for seat in self._seats:
            self._dismiss(seat)
        self._seats = []
        if self._owns_ray:
            self._ray.shutdown()

    def _listen(self, seat: RaySeat) -> Iterator[Finished | Death]:
        try:
            message = self._ray.get(seat.pending)
        except self._ray.exceptions.RayTaskError as error:
            # What one worker refuses when it opens, the next would refuse as well.
            if not seat.ready and isinstance(error.cause, SfkitError):
                raise InputError(str(error.cause)) from error
            yield from self._bury(seat, f"raised {type(error.cause).__name__}: {error.cause}")
        except self._ray.exceptions.RayError as error:
            yield from self._bury(seat, _ended(error))
        else:
            seat.pending, task, seat.task = None, seat.task, None
            self._welcome(seat)
            if task is not None:
                yield Finished(task, message)

    def _hire(self, seat: RaySeat) -> None:
        remote = self._ray.remote(RayWorker)
        # Restarted by Ray, a worker would be empty: crews hire anew, count, and give up with a sentence.
        options = {"num_cpus": 1, "num_gpus": self._gpus, "max_restarts": 0, "scheduling_strategy": "SPREAD"}
        seat.actor = remote.options(**options).remote()
        seat.pending = seat.actor.open.remote(self._order)

    def _dismiss(self, seat: RaySeat) -> None:
        self._ray.kill(seat.actor)

    def _given_up(self, seat: RaySeat) -> tuple[str, str]:
        return "Ray workers in a row", "engine 'ray': {}"

    def _places(self) -> int:
        resources = self._ray.cluster_resources()
        return max(1, int(resources.get("GPU" if self._gpus else "CPU", 0)))


def ray_engine(
    pool: Pool,
    benchmark: PreparedBenchmark,
    compute: Compute,
    *,
    threads: int = 1,
    start_seconds: float = START_SECONDS,
) -> ParallelEngine:
    """Ray actors, each on one GPU or one CPU.

    Args:
        pool: whose networks are merged.
        benchmark: prepared for the pool's architecture.
        compute: device ``"cpu"`` or ``"cuda"``, Ray says which GPU; ``workers``, one a GPU, or one a CPU, of
            the whole cluster unless given.
        threads: of torch in each worker.
        start_seconds: how long a worker may take to get ready, waiting for its GPU or CPU included.

    Raises:
        InputError: Ray is not installed, or a worker could not import the architecture.
    """
    ensure_ray()
    held, workers, kind = in_memory(benchmark), compute.workers, compute.kind
    plan = WorkerPlan.of(pool, held, benchmark.quantities, mode=compute.mode, threads=threads)

    def hire() -> RayCrew:
        # An empty entry is the working folder of whoever reads it, another one there.
        order = WorkerSetup(plan, SharedPool.of(pool), tuple(filter(None, sys.path)), kind)
        return RayCrew(order, workers, start_seconds)

    about = f"{workers or 'as many'} workers on {kind}" + ("" if workers else " as the cluster has room for")
    return ParallelEngine("ray", len(benchmark), workers, hire, about)


def connect(ray: Any) -> None:
    """Join the cluster of ``RAY_ADDRESS``, or start one here.

    Raises:
        SfkitError: there is none, and none can be started.
    """
    try:
        ray.init()
    except (ConnectionError, RuntimeError, TimeoutError) as error:
        raise SfkitError(
            f"engine 'ray': no cluster can be reached or started ({error}), connect with ray.init() first or "
            "set RAY_ADDRESS"
        ) from error


def _ended(error: Exception) -> str:
    """Ray's account of an actor's end, without its list of usual causes."""
    account = " ".join(str(error).split()).partition(" Some common causes")[0]
    return f"ended: {account.rpartition('Worker exit detail: ')[2]}"
