"""What both searches share: stepping, iterating, running, stopping, and the best so far."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from sfkit.cards import card
from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.outcome import Scorer
from sfkit.search.journal import STOP_REQUESTED, Journal
from sfkit.search.records import C, Counts, Generation, count, ranked

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class SearchState(Generic[C]):
    """All a search knows between two generations, a pure function of its seed and the scores it was given.

    Attributes:
        generation: the number of the last finished generation, -1 before the initial population.
        candidates: everything proposed so far, by number.
    """

    generation: int = -1
    candidates: tuple[C, ...] = ()


class Search(ABC, Generic[C]):
    """A search that can be stepped, iterated, run and asked to stop.

    Nothing is kept on disk: a search that was killed is built again with the same settings, and what the
    scorer has in its evaluation store passes by at once. A step either happens as a whole or, where the
    scorer raises or the user interrupts, leaves the state as it was; the next step then proposes the same
    candidates again.

    One thread steps; any other may read every property and call :meth:`request_stop` meanwhile.
    """

    kind: ClassVar[str]
    """What the journal calls this search."""
    predicted: ClassVar[tuple[str, ...]] = ()
    """Columns that its history has besides: what a model foretold, NaN where it proposed nothing."""

    def __init__(self, scorer: Scorer, journal: Journal | None) -> None:
        self._scorer = scorer
        self._journal = journal
        # The journal begins with the first step: a search that was made and never run leaves no trace.
        self._announced = False
        self._stop = threading.Event()
        self._running = threading.Lock()

    @property
    @abstractmethod
    def state(self) -> SearchState[C]:
        """The current state; frozen, so that a reader's copy never changes."""

    @property
    @abstractmethod
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""

    @property
    @abstractmethod
    def history(self) -> pd.DataFrame:
        """One row a candidate, in the order of creation."""

    @property
    def scorer(self) -> Scorer:
        """What scores the candidates."""
        return self._scorer

    @contextmanager
    def scored_by(self, scorer: Scorer) -> Iterator[None]:
        """Within this context steps ask another scorer; it must give the same scores, and can listen in."""
        before, self._scorer = self._scorer, scorer
        try:
            yield
        finally:
            self._scorer = before

    @property
    def done(self) -> bool:
        """True where no step is left."""
        return self.reason is not None

    @property
    def generation(self) -> int:
        """The number of the last finished generation, -1 before the initial population."""
        return self.state.generation

    @property
    def candidates(self) -> tuple[C, ...]:
        """Everything proposed so far, by number."""
        return self.state.candidates

    @property
    def counts(self) -> Counts:
        """Evaluations so far: distinct, cached, failed, and their seconds."""
        return count(self.state.candidates)

    @property
    def best(self) -> C | None:
        """The best candidate so far, the earlier one of a tie; None where nothing has a finite score."""
        scored = (candidate for candidate in self.state.candidates if not candidate.failed)
        return min(scored, key=lambda candidate: candidate.rank, default=None)

    def _repr_html_(self) -> str:
        counts = self.counts
        facts = {
            "metric": getattr(self._scorer, "metric", None),
            "state": f"finished: {self.reason}" if self.done else f"generation {self.generation}, goes on",
            "evaluations": f"{counts.distinct} ({counts.cached} from the store, {counts.failed} failed)",
        }
        rows = [
            (rank, f"{one.score:.2f}", one.number, ", ".join(one.subset))
            for rank, one in enumerate(self.archive(5), start=1)
        ]
        columns = ("best", "score", "candidate", "sources")
        return card(f"{self.kind.capitalize()} search", facts, columns=columns, rows=rows)

    def archive(self, size: int | None = None) -> tuple[C, ...]:
        """The best unique candidates, best first: ``size`` of them, or all that have a finite score."""
        return ranked(self.state.candidates)[:size]

    def step(self) -> Generation[C]:
        """Do one generation; step 0 scores the initial population.

        Returns:
            What the generation created.

        Raises:
            InputError: the search is done.
            SfkitError: another thread is inside this search.
        """
        # Not waiting: a second thread would then do a generation that nobody asked for.
        if not self._running.acquire(blocking=False):
            raise SfkitError(
                f"{self.kind} search: another thread is stepping it: wait, or call request_stop()"
            )
        try:
            return self._step()
        finally:
            self._running.release()

    def __iter__(self) -> Iterator[Generation[C]]:
        """Step until the search is done or :meth:`request_stop` was called; iterate again to go on."""
        while not self.done:
            if self._stop.is_set():
                # Cleared where it is obeyed: a request made before the run began ends it too.
                self._stop.clear()
                self._write("end", reason=STOP_REQUESTED)
                return
            yield self.step()

    def run(self, progress: Callable[[Generation[C]], None] | None = None) -> C:
        """Step until the search is done or asked to stop.

        Args:
            progress: called with each generation, in the thread that runs.

        Returns:
            The best candidate.

        Raises:
            SfkitError: nothing got a finite score.
        """
        for generation in self:
            if progress is not None:
                progress(generation)
        best = self.best
        if best is None:
            raise SfkitError(self._why_nothing())
        return best

    def request_stop(self) -> None:
        """Ask :meth:`run` or an iteration to end before its next generation; safe from any thread.

        A request is good for one ending: running again goes on from there.
        """
        self._stop.set()

    @abstractmethod
    def _advance(self) -> None:
        """Replace the state by that after one more generation."""

    @abstractmethod
    def _description(self) -> dict[str, Any]:
        """What the journal's start record says of this search."""

    @abstractmethod
    def _details(self) -> dict[str, Any]:
        """What the journal's generation record says beyond candidates, best and counts."""

    def _step(self) -> Generation[C]:
        if self.done:
            raise InputError(
                f"{self.kind} search: no step is left ({self.reason}): make a new search to go on"
            )
        # Earlier candidates were written with their own generation.
        before = len(self.state.candidates)
        self._advance()
        finished = Generation(
            number=self.state.generation,
            candidates=self.state.candidates[before:],
            best=self.best,
            counts=self.counts,
            done=self.done,
            reason=self.reason,
        )
        self._record(finished)
        return finished

    def _record(self, finished: Generation[C]) -> None:
        best = finished.best
        self._write(
            "generation",
            generation=finished.number,
            candidates=[candidate.as_record() for candidate in finished.candidates],
            best=None if best is None else {**best.as_record(), "recipe": best.recipe.as_dict()},
            counts=finished.counts,
            **self._details(),
        )
        if finished.done:
            self._write("end", reason=finished.reason)

    def _write(self, event: str, **fields: Any) -> None:
        if self._journal is None:
            return
        if not self._announced:
            self._announced = True
            self._journal.write("start", search=self.kind, **self._description())
        self._journal.write(event, search=self.kind, **fields)

    def _why_nothing(self) -> str:
        if not self.state.candidates:
            return f"{self.kind} search: stopped before its first candidate was scored: run it again"
        first = self.state.candidates[0].outcome
        found = first.error or f"a score of {first.score}"
        return (
            f"{self.kind} search: none of {len(self.state.candidates)} candidates has a finite score, "
            f"the first one's outcome was: {found}"
        )
