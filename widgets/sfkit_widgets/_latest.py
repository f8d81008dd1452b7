"""Work beside the commands: of several jobs asked for in a row only the latest is done."""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from weakref import WeakSet

Job = Callable[[], None]

PATIENCE = 10.0
"""Seconds a process that ends waits for a job that has begun."""


class Latest:
    """Runs the latest job in a thread of its own, once no other has come for a while.

    A job that has begun is finished; one that has not is replaced by the next. Jobs look after their own
    exceptions (:meth:`~sfkit_widgets._base.SfkitWidget.reporting`).

    Args:
        pause: seconds to wait for a later job.
    """

    def __init__(self, pause: float = 0.0) -> None:
        self.pause = pause
        self._changed = threading.Condition()
        self._job: Job | None = None
        self._due = 0.0
        self._thread: threading.Thread | None = None
        _ALL.add(self)

    def submit(self, job: Job) -> None:
        """Do this one, unless another comes first."""
        with self._changed:
            self._job, self._due = job, time.monotonic() + self.pause
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def cancel(self) -> None:
        """Forget the job that has not begun."""
        with self._changed:
            self._job = None
            self._changed.notify_all()

    def join(self, timeout: float | None = None) -> None:
        """Wait until nothing is left to do, or ``timeout`` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._thread is None, timeout)

    def _work(self) -> None:
        while (job := self._next()) is not None:
            job()

    def _next(self) -> Job | None:
        """The latest job when it is due; None, and the end of the thread, where there is none."""
        with self._changed:
            while self._job is not None and (left := self._due - time.monotonic()) > 0:
                self._changed.wait(left)
            job, self._job = self._job, None
            if job is None:
                self._thread = None
                self._changed.notify_all()
            return job


_ALL: WeakSet[Latest] = WeakSet()


@atexit.register
def _end() -> None:
    """A network that still runs while the interpreter goes away aborts the process."""
    for latest in list(_ALL):
        latest.cancel()
        latest.join(PATIENCE)
