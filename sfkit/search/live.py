"""A search in a thread of its own: it is run, paused, stepped and stopped while the caller goes on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any
from weakref import ReferenceType, WeakKeyDictionary, ref

from sfkit.errors import SfkitError
from sfkit.search.base import Search
from sfkit.search.interruptible import HoldError, interruptible, metric_of
from sfkit.search.progress import (
    Best,
    Phase,
    Progress,
    best_of,
    last_generation,
    most_candidates,
    next_size,
    time_left,
)
from sfkit.search.records import Counts
from sfkit.search.runs import STAGES


class _Wanted(Enum):
    """What the last command asked for."""

    RUN = auto()
    STEP = auto()  # to the end of the generation under way, or of the next one
    PAUSE = auto()
    STOP = auto()


class _HaltError(Exception):
    """Breaks a generation off between two evaluations."""


@dataclass(frozen=True)
class _Within:
    """Recipes of the generation under way: from the store, done, all; and the generation before it."""

    cached: int = 0
    done: int = 0
    every: int = 1
    after: int = -2


_NOTHING = _Within()


class LiveSearch:
    """A search that runs in a daemon thread, for widgets and for cells that want their prompt back.

    :meth:`run`, :meth:`pause`, :meth:`step` and :meth:`stop` say what is wanted and return at once; they
    and :meth:`progress` may be called from any thread. A command takes effect after the evaluation under
    way. A pause keeps its place inside a generation. A stop lets go of an unfinished generation, whose
    evaluations are in the store: run again, they pass by at once. Interrupting the kernel reaches its
    main thread and never this one. Whatever the scorer raises ends the thread and is kept in
    ``progress().error``; the search's state is then that of its last finished generation.

    The outcome does not depend on any of this: a search paused, stopped and run on finds what it would
    have found at once.
    """

    def __init__(self, search: Search[Any]) -> None:
        """Nothing runs before the first command.

        Raises:
            InputError: a search that is neither Stage 1 nor Stage 2.
        """
        self.search = search
        self.metric = metric_of(search.scorer)
        self._total = most_candidates(search)
        self._changed = threading.Condition()
        self._wanted = _Wanted.PAUSE
        self._phase = Phase.FINISHED if search.done else Phase.READY
        self._thread: threading.Thread | None = None
        self._error: str | None = None
        self._within = _NOTHING
        # The pace is of what runs here: earlier candidates took none of this time.
        self._first = len(search.candidates)
        self._ran = 0.0
        self._since: float | None = None
        self._known: tuple[object, Counts, Best | None] | None = None
        _LIVE[search] = ref(self)

    @classmethod
    def of(cls, search: Search[Any]) -> LiveSearch:
        """The live session of a search: the one it has, or a new one."""
        held = _LIVE.get(search)
        live = None if held is None else held()
        return cls(search) if live is None else live

    def run(self) -> None:
        """Go on until the search is done, or another command comes."""
        self._want(_Wanted.RUN)

    def step(self) -> None:
        """Finish the generation under way, or do the next one, then pause."""
        self._want(_Wanted.STEP)

    def pause(self) -> None:
        """Hold after the evaluation under way."""
        with self._changed:
            if self._alive() and self._phase in (Phase.RUNNING, Phase.PAUSING):
                self._wanted = _Wanted.PAUSE
                self._enter(Phase.PAUSING)

    def stop(self) -> None:
        """End after the evaluation under way; the journal is told."""
        with self._changed:
            if self._alive():
                self._wanted = _Wanted.STOP
                self._enter(Phase.STOPPING)

    def progress(self) -> Progress:
        """How far the search is, at this moment."""
        with self._changed:
            search, (counts, best) = self.search, self._summary()
            # What the scorer reported of a generation that is over is in the search's own counts by now.
            within = self._within if self._within.after == search.generation else _NOTHING
            candidates = counts.candidates + round(within.done / within.every * next_size(search))
            ran = self._seconds()
            settled = self._phase in (Phase.READY, Phase.STOPPED, Phase.FINISHED, Phase.FAILED)
            phase = Phase.FINISHED if settled and search.done else self._phase
            pace = time_left(ran, candidates - self._first, self._total - self._first)
            return Progress(
                stage=STAGES[search.kind],
                phase=phase,
                generation=search.generation,
                generations=last_generation(search),
                candidates=candidates,
                total=self._total,
                counts=replace(
                    counts,
                    candidates=candidates,
                    distinct=counts.distinct + within.done,
                    cached=counts.cached + within.cached,
                ),
                best=best,
                running=ran,
                left=None if search.done else pace,
                reason=search.reason,
                error=self._error,
            )

    def wait(self, until: Callable[[Progress], bool] | None = None, timeout: float | None = None) -> Progress:
        """Block until the search settles (is paused, stopped, finished or failed), or ``until`` is true.

        Args:
            until: of the progress; looked at whenever something happens.
            timeout: seconds; None waits as long as it takes.

        Raises:
            SfkitError: it did not come to that in time.
        """
        met = until or (lambda progress: progress.settled)
        with self._changed:
            if not self._changed.wait_for(lambda: met(self.progress()), timeout):
                raise SfkitError(f"{self.search.kind} search: still {self._phase} after {timeout:g} s")
            return self.progress()

    def _summary(self) -> tuple[Counts, Best | None]:
        """Counts and best of the finished generations; looked up again only after a new one."""
        # A state is frozen, so that its summary holds as long as it is the same object.
        if self._known is None or self._known[0] is not self.search.state:
            self._known = (self.search.state, self.search.counts, best_of(self.search))
        return self._known[1:]

    def _want(self, wanted: _Wanted) -> None:
        with self._changed:
            # A stop that is under way is not taken back: the thread may be past the last look at what is
            # wanted.
            if self.search.done or (self._wanted is _Wanted.STOP and self._alive()):
                return
            self._wanted, self._error = wanted, None
            self._enter(Phase.RUNNING)
            if not self._alive():
                name = f"sfkit {self.search.kind} search"
                self._thread = threading.Thread(target=self._work, name=name, daemon=True)
                self._thread.start()

    def _alive(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _enter(self, phase: Phase) -> None:
        """Change the phase and the clock with it; the lock is held."""
        now = time.monotonic()
        self._ran = self._seconds()
        self._since = now if phase in (Phase.RUNNING, Phase.PAUSING, Phase.STOPPING) else None
        self._phase = phase
        self._changed.notify_all()

    def _seconds(self) -> float:
        return self._ran + (0.0 if self._since is None else time.monotonic() - self._since)

    def _work(self) -> None:
        """The thread: generations until done, a stop, or an error."""
        phase, error = Phase.STOPPED, None
        try:
            # The scorer reports between two evaluations, where a pause or a stop takes effect.
            with self.search.scored_by(interruptible(self.search.scorer, _LiveMonitor(self))):
                self._go()
        except _HaltError:
            self.search.request_stop()
            for _ in self.search:  # takes no step: it sees the request, and writes it into the journal
                break
        except Exception as raised:  # whatever it is, the person who watches must see it
            kind = "" if isinstance(raised, SfkitError) else f"{type(raised).__name__}: "
            phase, error = Phase.FAILED, f"{kind}{raised}"
        self._settle(Phase.FINISHED if self.search.done else phase, error)

    def _go(self) -> None:
        # A pause may come before the first generation.
        self._hold()
        for _ in self.search:
            with self._changed:
                if self._wanted is _Wanted.STEP:
                    self._wanted = _Wanted.PAUSE
                self._changed.notify_all()
            if not self.search.done:
                self._hold()

    def _report(self, done: int, total: int) -> None:
        with self._changed:
            before, generation = self._within, self.search.generation
            # The first report of a generation tells what the store held.
            cached = before.cached if before.after == generation else done
            self._within = _Within(cached, done, max(total, 1), generation)
            self._changed.notify_all()
            # Not after the last evaluation: its generation is over, and is recorded first.
            if done < total and self._wanted is _Wanted.PAUSE:
                raise HoldError
            if done < total and self._wanted is _Wanted.STOP:
                raise _HaltError

    def _hold(self) -> None:
        """Block while a pause is wanted; the way on, or out."""
        with self._changed:
            while self._wanted is _Wanted.PAUSE:
                if self._phase is not Phase.PAUSED:
                    self._enter(Phase.PAUSED)
                self._changed.wait()
            if self._wanted is _Wanted.STOP:
                raise _HaltError
            if self._phase is not Phase.RUNNING:
                self._enter(Phase.RUNNING)

    def _settle(self, phase: Phase, error: str | None = None) -> None:
        with self._changed:
            self._within, self._error, self._wanted = _NOTHING, error, _Wanted.PAUSE
            # This thread still runs for a moment: dropped, so that a command meanwhile starts another.
            self._thread = None
            self._enter(phase)


class _LiveMonitor:
    """Where the scorer reports its work."""

    def __init__(self, live: LiveSearch) -> None:
        self.report, self.hold = live._report, live._hold


# Weak on both sides: looking at a search must not keep it, or its networks, in memory.
_LIVE: WeakKeyDictionary[Search[Any], ReferenceType[LiveSearch]] = WeakKeyDictionary()
