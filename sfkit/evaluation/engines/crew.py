"""What parallel engines share: workers on seats, their bookkeeping, and the loop that keeps them busy."""

from __future__ import annotations

import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sfkit.errors import SfkitError, SfkitWarning
from sfkit.evaluation.engines.schedule import TRIES, Board, ImageRange
from sfkit.evaluation.engines.worker import Result
from sfkit.merging.recipe import Recipe

START_SECONDS = 600.0  # a worker that takes longer to get ready hangs: reading 18 GB takes some minutes
LOOK_SECONDS = 5.0  # a message shows a worker's end, unless another process holds its channel open too


@dataclass(frozen=True)
class Task:
    """A part of a recipe, and the call of the engine it belongs to."""

    call: int
    part: ImageRange
    recipe: Recipe


@dataclass(frozen=True)
class Finished:
    """A worker finished a task."""

    task: Task
    result: Result


@dataclass(frozen=True)
class Death:
    """A worker died over a task, ``how`` being the last part of a sentence."""

    task: Task
    how: str


@dataclass(eq=False, kw_only=True)
class Seat:
    """A place for one worker after the other.

    Attributes:
        deadline: when its worker must be ready, on the monotonic clock.
        ready: whether it takes tasks.
        task: what it does now.
        failures: workers in a row that never got ready.
    """

    deadline: float = 0.0
    ready: bool = False
    task: Task | None = None
    failures: int = 0


S = TypeVar("S", bound=Seat)


class Crew(ABC, Generic[S]):
    """Workers on seats. A seat's worker is replaced when it dies.

    Args:
        start_seconds: how long a worker may take to get ready.
    """

    def __init__(self, start_seconds: float) -> None:
        self._start_seconds = start_seconds
        self._seats: list[S] = []

    @property
    def size(self) -> int:
        """How many workers take part."""
        return len(self._seats)

    def free(self) -> list[int]:
        """The seats whose workers wait for a task."""
        return [n for n, seat in enumerate(self._seats) if seat.ready and seat.task is None]

    @abstractmethod
    def give(self, number: int, task: Task) -> None:
        """Give a free seat a task."""

    @abstractmethod
    def events(self) -> Iterable[Finished | Death]:
        """Wait until something happens; it may concern no task.

        Raises:
            InputError: a worker refuses to work, because what it found is not what it should have.
            SfkitError: no worker can be started.
        """

    @abstractmethod
    def close(self) -> None:
        """End all workers."""

    @abstractmethod
    def _hire(self, seat: S) -> None:
        """Start a worker on a seat."""

    @abstractmethod
    def _dismiss(self, seat: S) -> None:
        """Let go of what is left of a seat's worker."""

    @abstractmethod
    def _given_up(self, seat: S) -> tuple[str, str]:
        """Whose workers did not get ready, and what to say where no other is left, the reason as ``{}``."""

    def _occupy(self, seat: S) -> None:
        seat.ready, seat.deadline = False, time.monotonic() + self._start_seconds
        self._hire(seat)

    def _welcome(self, seat: S) -> None:
        seat.ready, seat.failures = True, 0

    def _late(self) -> list[S]:
        """The seats whose workers should have been ready by now."""
        return [seat for seat in self._seats if not seat.ready and time.monotonic() > seat.deadline]

    def _bury(self, seat: S, how: str) -> Iterator[Death]:
        """Replace a dead worker; a seat on which none gets ready is given up."""
        self._dismiss(seat)
        task, seat.task = seat.task, None
        # One that was ready died over its task, which the board counts, not over its seat.
        seat.failures = 0 if seat.ready else seat.failures + 1
        if seat.failures < TRIES:
            self._occupy(seat)
        else:
            self._give_up(seat, how)
        if task is not None:
            yield Death(task, how)

    def _give_up(self, seat: S, how: str) -> None:
        self._seats.remove(seat)
        workers, nobody = self._given_up(seat)
        reason = f"{TRIES} {workers} did not get ready, the last {how}"
        if not self._seats:
            raise SfkitError(nobody.format(reason))
        warnings.warn(f"{reason}: going on with {self.size} of them", SfkitWarning, stacklevel=2)

    def _patience(self) -> float:
        """Seconds to wait for a message, so that the next worker that is late shows in time."""
        due = [seat.deadline - time.monotonic() for seat in self._seats if not seat.ready]
        return max(0.0, min([LOOK_SECONDS, *due]))


class ParallelEngine:
    """An engine whose workers live elsewhere; they start with the first recipe and stay.

    Args:
        name: what users call it.
        images: how many the benchmark has.
        workers: how many are asked for; None where the crew will tell.
        hire: starts a crew.
        about: what the crew is, for :meth:`describe`.
    """

    def __init__(
        self, name: str, images: int, workers: int | None, hire: Callable[[], Crew[Any]], about: str
    ) -> None:
        self.name = name
        self._images, self._asked, self._hire, self._about = images, workers, hire, about
        self._crew: Crew[Any] | None = None
        self._calls = 0

    @property
    def workers(self) -> int:
        """How many evaluate at a time; 1 where that is not known before they start."""
        return self._crew.size if self._crew is not None else self._asked or 1

    def start(self) -> None:
        """Start the workers and wait until all are ready; without this, the first recipe starts them.

        Raises:
            InputError: as :meth:`run`.
            SfkitError: as :meth:`run`.
        """
        try:
            crew = self._hired()
            while len(crew.free()) < crew.size:
                list(crew.events())  # what they answer to a call that was given up
        except BaseException:
            self.close()
            raise

    def run(self, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        """Evaluate recipes; each result is handed over as soon as it is there, with its number.

        Raises:
            InputError: workers cannot do what this process could; see
                :class:`~sfkit.evaluation.engines.plan.WorkerPlan`.
            SfkitError: no worker can be started.
        """
        if not recipes:
            return
        self._calls += 1
        try:
            crew = self._hired()
            yield from self._drive(crew, Board(len(recipes), self._images, crew.size), recipes)
        except GeneratorExit:  # what is under way is left to finish: its answers will name another call
            raise
        except BaseException:  # an interrupt can fall between two halves of a message
            self.close()
            raise

    def describe(self) -> str:
        """What it runs on, for people."""
        return f"{self.name}: {self._about}"

    def close(self) -> None:
        """End the workers; they start again with the next recipe."""
        crew, self._crew = self._crew, None
        if crew is not None:
            crew.close()

    def _hired(self) -> Crew[Any]:
        if self._crew is None:
            self._crew = self._hire()
        return self._crew

    def _drive(
        self, crew: Crew[Any], board: Board, recipes: Sequence[Recipe]
    ) -> Iterator[tuple[int, Result]]:
        call = self._calls
        while not board.complete:
            for seat in crew.free():
                part = board.take()
                if part is None:
                    break
                crew.give(seat, Task(call, part, recipes[part.number]))
            for event in crew.events():
                # Of a call that was given up: its answers were on their way.
                if event.task.call != call:
                    continue
                if isinstance(event, Finished):
                    yield from board.done(event.task.part, event.result)
                else:
                    yield from board.died(event.task.part, event.how)
