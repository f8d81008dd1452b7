"""The processes engine: persistent worker processes, one a device, or several sharing the CPU.

It has run on CPUs only, on no GPU yet.
"""

from __future__ import annotations

import os
import pickle
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from pathlib import Path

import torch

from sfkit.errors import InputError
from sfkit.evaluation.compute import Compute
from sfkit.evaluation.engines import reserve
from sfkit.evaluation.engines.child import Here, Ready, Refused
from sfkit.evaluation.engines.crew import START_SECONDS, Crew, Death, Finished, ParallelEngine, Seat, Task
from sfkit.evaluation.engines.plan import WorkerPlan, fair_threads
from sfkit.evaluation.engines.reserve import Surroundings
from sfkit.evaluation.engines.spawned import Spawned, stop
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.pool import Pool


@dataclass(eq=False)
class ProcessSeat(Seat):
    """A seat on one device, and the process that works there now."""

    device: str
    process: Spawned = field(init=False)
    surroundings: Surroundings = field(init=False)


class ProcessCrew(Crew[ProcessSeat]):
    """Spawned processes on this machine.

    Args:
        plan: what every worker becomes.
        devices: one entry a worker.
        start_seconds: how long a worker may take to get ready.

    Raises:
        InputError: the plan cannot be sent to another process.
    """

    def __init__(
        self, plan: WorkerPlan, devices: Sequence[str], start_seconds: float = START_SECONDS
    ) -> None:
        super().__init__(start_seconds)
        self.plan = plan
        self._folder = Path.cwd()
        # Pickled once: a plan with pairs in memory is large, and every replacement gets the same bytes.
        self._orders = {device: self._pickled(device) for device in devices}
        self._taken: list[ProcessSeat] = []
        # On a GPU memory stays taken, and a lost device stays lost, for as long as the process lives.
        kept = plan.leaves_no_trace and all(device == "cpu" for device in devices)
        self._end = weakref.finalize(self, leave, self._taken, kept)
        self._seats = [ProcessSeat(device) for device in devices]
        for seat in self._seats:
            self._occupy(seat)

    def give(self, number: int, task: Task) -> None:
        """Give a free seat a task."""
        seat = self._seats[number]
        seat.task = task
        seat.process.send((task.recipe, task.part.start, task.part.stop))

    def events(self) -> Iterator[Finished | Death]:
        """Wait until something happens: an answer, an end, a worker that is ready, or one that hangs."""
        # Channels alone: a process that ends closes its own, which wakes this as a message does.
        ready = connection.wait([seat.process.channel for seat in self._seats], self._patience())
        # A copy: a seat that is given up leaves the list meanwhile.
        for seat in tuple(self._seats):
            if seat.process.channel in ready:
                yield from self._listen(seat)
            # What it said last is read first: it may be a result.
            elif not seat.process.running and not seat.process.channel.poll():
                yield from self._bury(seat, seat.process.ended())
            elif seat in self._late():
                seat.process.kill()
                yield from self._bury(seat, f"was not ready after {self._start_seconds:g} s")

    def close(self) -> None:
        """End all workers, but for those that can follow the next plan."""
        self._end()

    def _listen(self, seat: ProcessSeat) -> Iterator[Finished | Death]:
        try:
            message = seat.process.channel.recv()
        except (EOFError, OSError):
            yield from self._bury(seat, seat.process.ended())
            return
        if isinstance(message, Here):
            seat.process.send_pickled(self._orders[seat.device])
        elif isinstance(message, Ready):
            self._welcome(seat)
        elif isinstance(message, Refused):
            raise InputError(message.why)
        elif isinstance(message, Result) and seat.task is not None:
            task, seat.task = seat.task, None
            yield Finished(task, message)

    def _hire(self, seat: ProcessSeat) -> None:
        seat.surroundings, seat.process = reserve.worker(self.plan.threads, self._folder)
        self._taken.append(seat)

    def _dismiss(self, seat: ProcessSeat) -> None:
        seat.process.release()
        self._taken.remove(seat)

    def _given_up(self, seat: ProcessSeat) -> tuple[str, str]:
        wrote = "what they wrote on standard error says more"
        return f"workers in a row on {seat.device}", f"engine 'processes': {{}}; {wrote}"

    def _pickled(self, device: str) -> bytes:
        try:
            return pickle.dumps((self.plan, device))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InputError(
                f"benchmark {self.plan.benchmark.name!r}: cannot be sent to workers ({error}), expected "
                "pairs of a class that is defined in a module; or use engine='inline'"
            ) from error


def leave(taken: Sequence[ProcessSeat], kept: bool) -> None:
    """Let go of a crew's workers; those that wait for a task go to the reserve, where it may have them."""
    here = [seat for seat in taken if seat.process.owner == os.getpid()]  # a fork owns none of them
    # A message that an interrupt cut in two leaves its seat not ready, or with a task.
    idle = [seat for seat in here if kept and seat.ready and seat.task is None and seat.process.running]
    stay = [seat for seat in idle if reserve.keep(seat.surroundings, seat.process)]
    stop([seat.process for seat in here if seat not in stay])


def process_engine(
    pool: Pool,
    benchmark: PreparedBenchmark,
    compute: Compute,
    *,
    threads: int | None = None,
    start_seconds: float = START_SECONDS,
) -> ParallelEngine:
    """Worker processes on this machine.

    Args:
        pool: whose networks are merged; each worker opens its files again.
        benchmark: prepared for the pool's architecture; each worker reads its files again.
        compute: device ``"cpu"``, ``"cuda"`` for all GPUs in turn, or ``"cuda:0"`` for one; ``workers``, one
            a GPU, or one a CPU core, unless given. Each holds a network and the images; task vectors of big
            pools lie in mapped files that all share.
        threads: of torch in each worker; this process's threads are shared out unless given.
        start_seconds: how long a worker may take to get ready.

    Raises:
        InputError: a worker could not import the architecture or the benchmark's pairs.
    """
    devices = seats_on(compute.device, compute.workers)
    share = threads or fair_threads(len(devices))
    plan = WorkerPlan.of(pool, benchmark.benchmark, benchmark.quantities, mode=compute.mode, threads=share)
    about = f"{len(devices)} worker{'s' * (len(devices) > 1)} on {', '.join(dict.fromkeys(devices))}"
    threaded = f"{about}, {share} thread{'s' * (share > 1)} each"

    def hire() -> ProcessCrew:
        return ProcessCrew(plan, devices, start_seconds)

    return ParallelEngine("processes", len(benchmark), len(devices), hire, threaded)


def seats_on(device: str, workers: int | None) -> tuple[str, ...]:
    """The device of each worker: GPUs in turn for ``"cuda"``, else the one that is named."""
    if device == "cuda":
        # One at least: that it is not there shows when a network is made.
        gpus = [f"cuda:{n}" for n in range(torch.cuda.device_count())] or ["cuda:0"]
        return tuple(gpus[n % len(gpus)] for n in range(workers or len(gpus)))
    return (device,) * (workers or (cores() if device == "cpu" else 1))


def cores() -> int:
    """CPU cores that this process may use."""
    # A container or a job may have fewer than the machine.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
