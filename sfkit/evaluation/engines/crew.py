"""What parallel engines share: a crew of workers, and the loop that keeps it busy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from sfkit.evaluation.engines.schedule import Board, Part
from sfkit.evaluation.engines.worker import Result
from sfkit.merging.recipe import Recipe

START_SECONDS = 600.0  # a worker that takes longer to get ready hangs: reading 18 GB takes some minutes


@dataclass(frozen=True)
class Task:
    """A part of a recipe, and the call of the engine it belongs to."""

    call: int
    part: Part
    recipe: Recipe


@dataclass(frozen=True)
class Answer:
    """A worker finished a task."""

    task: Task
    result: Result


@dataclass(frozen=True)
class Death:
    """A worker died over a task, ``how`` being the last part of a sentence."""

    task: Task
    how: str


class Crew(Protocol):
    """Workers on seats. A seat's worker is replaced when it dies."""

    @property
    def size(self) -> int:
        """How many workers take part."""
        ...

    def free(self) -> Sequence[int]:
        """The seats whose workers wait for a task."""
        ...

    def give(self, seat: int, task: Task) -> None:
        """Give a free seat a task."""
        ...

    def events(self) -> Iterable[Answer | Death]:
        """Wait until something happens; it may concern no task.

        Raises:
            InputError: a worker refuses to work, because what it found is not what it should have.
            SfkitError: no worker can be started.
        """
        ...

    def close(self) -> None:
        """End all workers."""
        ...


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
        self, name: str, images: int, workers: int | None, hire: Callable[[], Crew], about: str
    ) -> None:
        self.name = name
        self._images, self._asked, self._hire, self._about = images, workers, hire, about
        self._crew: Crew | None = None
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

    def _hired(self) -> Crew:
        if self._crew is None:
            self._crew = self._hire()
        return self._crew

    def _drive(self, crew: Crew, board: Board, recipes: Sequence[Recipe]) -> Iterator[tuple[int, Result]]:
        call = self._calls
        while not board.complete:
            for seat in crew.free():
                part = board.take()
                if part is None:
                    break
                crew.give(seat, Task(call, part, recipes[part.number]))
            for event in crew.events():
                if event.task.call != call:
                    continue
                if isinstance(event, Answer):
                    yield from board.done(event.task.part, event.result)
                else:
                    yield from board.died(event.task.part, event.how)
