"""Worker processes between two plans: a notebook that evaluates in twenty cells starts its workers once.

A worker's imports take seconds of processor time, far more than opening a small pool. One that has followed
a plan to its end, and has run no code but sfkit's, waits here for the next crew of this process; after
:data:`~sfkit.evaluation.engines.child.IDLE_SECONDS` without one it ends by itself.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sfkit.evaluation.engines.child import Done
from sfkit.evaluation.engines.spawned import Spawned, stop


@dataclass(frozen=True)
class Surroundings:
    """What a process gets when it starts, and keeps: workers of other surroundings are no substitute."""

    threads: int
    folder: Path
    path: tuple[str, ...]
    environment: frozenset[tuple[str, str]]

    @classmethod
    def here(cls, threads: int, folder: Path) -> Surroundings:
        """Those that a process started now would get."""
        # The whole environment: libraries read variables of theirs when they are imported.
        return cls(threads, folder, tuple(sys.path), frozenset(os.environ.items()))


_waiting: list[tuple[Surroundings, Spawned]] = []
_lock = threading.Lock()


def worker(threads: int, folder: Path) -> tuple[Surroundings, Spawned]:
    """A process that waits for a plan: one of the reserve, or a new one."""
    wanted = Surroundings.here(threads, folder)
    with _lock:
        # A fork of this process owns none.
        serving = [e for e in _waiting if e[0] == wanted and e[1].owner == os.getpid() and e[1].running]
        # What cannot serve would hold memory for nobody.
        _end([entry for entry in _waiting if entry not in serving])
        return _waiting.pop() if _waiting else (wanted, Spawned(threads, folder))


def keep(surroundings: Surroundings, process: Spawned) -> bool:
    """Let a process that waits for a task wait for a plan instead; those of other surroundings end.

    Returns:
        False where the reserve is at work: a crew may be collected, and end, in the middle of that, in the
        same thread, and would wait for itself.
    """
    if not _lock.acquire(blocking=False):
        return False
    try:
        _end([entry for entry in _waiting if entry[0] != surroundings])
        process.send(Done())
        _waiting.append((surroundings, process))
    finally:
        _lock.release()
    return True


@atexit.register
def clear() -> None:
    """End all that wait."""
    _end(tuple(_waiting))


def _end(entries: Sequence[tuple[Surroundings, Spawned]]) -> None:
    for entry in entries:
        _waiting.remove(entry)
    stop(process for _, process in entries)
