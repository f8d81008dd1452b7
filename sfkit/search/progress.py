"""How far a search is: one record, from a search in this process or from the journal of one elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from datetime import datetime
from enum import StrEnum
from typing import Any

from sfkit.errors import InputError
from sfkit.search.base import Search
from sfkit.search.journal import JournalledSearch
from sfkit.search.records import Counts, Generation
from sfkit.search.routing import RoutingSearch
from sfkit.search.runs import STAGES
from sfkit.search.subset import SubsetSearch


class Phase(StrEnum):
    """What a search is doing."""

    READY = "ready"  # nothing was started yet
    RUNNING = "running"
    PAUSING = "pausing"  # asked to pause; the evaluation under way is still computed
    PAUSED = "paused"  # between two evaluations, and goes on from there
    STOPPING = "stopping"
    STOPPED = "stopped"  # between two generations; what was evaluated is in the store
    FINISHED = "finished"
    FAILED = "failed"  # the scorer raised; running again tries again
    OPEN = "open"  # elsewhere: it runs, or was killed; its journal tells no more


@dataclass(frozen=True)
class Best:
    """The best candidate so far: its number, score (in the metric's unit) and sources."""

    number: int
    score: float
    subset: tuple[str, ...]


@dataclass(frozen=True)
class Progress:
    """How far a search is.

    Attributes:
        stage: ``Stage 1`` or ``Stage 2``.
        phase: what it is doing.
        generation: the last finished one, -1 before the first.
        generations: the last one there will be; None in Stage 2, which counts evaluations.
        candidates: proposed and answered, those of an unfinished generation included, as far as known.
        total: the most there will be.
        counts: evaluations asked for: distinct, cached, failed, seconds; an unfinished generation is in
            distinct and cached, not yet in failed.
        best: of all finished generations; None where nothing has a finite score.
        running: seconds it has run for: by the clock in this process, in evaluations elsewhere.
        left: estimate of the seconds left at most; None where there is nothing to estimate from.
        reason: why no step is left, or why it ended; None where neither.
        error: why it failed, one sentence.
        written: when its journal was last written; None in this process.
    """

    stage: str
    phase: Phase
    generation: int
    generations: int | None
    candidates: int
    total: int
    counts: Counts
    best: Best | None
    running: float
    left: float | None
    reason: str | None = None
    error: str | None = None
    written: datetime | None = None

    @property
    def settled(self) -> bool:
        """True where nothing is under way."""
        busy = (Phase.RUNNING, Phase.PAUSING, Phase.STOPPING, Phase.OPEN)
        return self.phase not in busy


def best_of(search: Search[Any]) -> Best | None:
    """The best candidate of the finished generations."""
    best = search.best
    return None if best is None else Best(best.number, best.score, best.subset)


def generation_note(generation: Generation[Any]) -> str:
    """The best so far, such as ``best 12.3456 (kitti, indoor)``."""
    best = generation.best
    return "best none yet" if best is None else f"best {best.score:.2f} ({', '.join(best.subset)})"


def last_generation(search: Search[Any]) -> int | None:
    """The number of the last generation; None where the number of evaluations ends the search."""
    return search.settings.generations if isinstance(search, SubsetSearch) else None


def most_candidates(search: Search[Any]) -> int:
    """The most candidates a search will propose.

    Raises:
        InputError: a search that is neither Stage 1 nor Stage 2.
    """
    if isinstance(search, SubsetSearch):
        return search.most
    if isinstance(search, RoutingSearch):
        return search.settings.evaluations
    raise InputError(f"search: found a {type(search).__name__}, expected SubsetSearch or RoutingSearch")


def next_size(search: Search[Any]) -> int:
    """How many candidates the next generation has at most."""
    left = most_candidates(search) - len(search.candidates)
    if isinstance(search, RoutingSearch):
        # Generation 0 is x = 0, and the start where one is given.
        size = 1 + (search.start is not None) if search.generation < 0 else search.population
    else:
        size = left
        if isinstance(search, SubsetSearch):
            size = search.initial if search.generation < 0 else search.settings.offspring
    return min(size, left)


def time_left(seconds: float, done: float, total: float) -> float | None:
    """Seconds left at the pace so far; an upper bound, since later candidates are more often repeated."""
    return None if done <= 0 or seconds <= 0 else seconds / done * max(total - done, 0.0)


def watched_progress(records: Iterable[Mapping[str, Any]], search: str) -> Progress:
    """The progress of a search that runs elsewhere.

    Args:
        records: what :func:`~sfkit.search.journal.read_journal` returned.
        search: ``subset`` or ``routing``.

    Raises:
        InputError: the journal holds no such search.
    """
    found = JournalledSearch.find(records, search)
    if found is None:
        raise InputError(f"journal: found no {search} search, expected one: run it with journal=Journal(...)")
    settings, counts = found.settings, Counts(**_known(found.counts))
    first_stage = search == SubsetSearch.kind
    total = found.most if first_stage else int(settings["evaluations"])
    return Progress(
        stage=STAGES[search],
        phase=Phase.OPEN if found.end is None else Phase.STOPPED if found.stopped else Phase.FINISHED,
        generation=found.generation,
        generations=int(settings["generations"]) if first_stage else None,
        candidates=counts.candidates,
        total=total,
        counts=counts,
        best=_best(found.best),
        running=counts.seconds,
        left=None if found.end else time_left(counts.seconds, counts.candidates, total),
        reason=found.reason,
        written=found.written,
    )


def _best(entry: Mapping[str, Any] | None) -> Best | None:
    if entry is None:
        return None
    return Best(int(entry["candidate"]), float(entry["score"]), tuple(entry["subset"]))


def _known(counts: Mapping[str, Any]) -> dict[str, Any]:
    # A journal of another version may count other things.
    names = [field.name for field in fields(Counts)]
    return {name: counts[name] for name in names if name in counts}
