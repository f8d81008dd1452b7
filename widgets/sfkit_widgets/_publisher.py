"""One thread that looks, about eight times a second, whether there is something new to show."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Protocol
from weakref import WeakSet, ref

PULSE = 0.125
"""Seconds between two looks: more often than that is not seen, and would slow the search down."""


class Refreshing(Protocol):
    """A widget that can bring its traits up to date."""

    keys: Sequence[str]
    """Names of its synchronised traits."""

    def refresh(self) -> None:
        """Show what is new; cheap where nothing is, and never raises."""

    def send_state(self, key: Sequence[str]) -> None:
        """Send these traits to the browser."""


class Publisher:
    """Refreshes widgets from one daemon thread, until they are closed or gone."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._widgets: WeakSet[Refreshing] = WeakSet()
        self._left: deque[ref[Refreshing]] = deque()
        self._thread: threading.Thread | None = None
        self._pulse = threading.Event()

    def follow(self, widget: Refreshing) -> None:
        """Refresh a widget from now on."""
        with self._lock:
            self._forget()
            self._widgets.add(widget)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="sfkit widgets", daemon=True)
                self._thread.start()

    def leave(self, widget: Refreshing) -> None:
        """Refresh it no longer.

        A widget that is collected leaves too, at any moment: also while this thread holds the lock, or at
        the interpreter's end, when a thread that held it has stopped for good. So this takes no lock.
        """
        self._left.append(ref(widget))

    def send_again(self) -> None:
        """Refresh all widgets now and send their state from this thread, changed or not.

        A run without a screen (nbclient, papermill) keeps of a widget only what was sent by a cell, in the
        kernel's main thread.
        """
        with self._lock:
            self._forget()
            widgets = list(self._widgets)
        for widget in widgets:
            widget.refresh()
            widget.send_state([name for name in widget.keys if not name.startswith("_")])

    def _work(self) -> None:
        while widgets := self._next():
            for widget in widgets:
                widget.refresh()
            del widgets, widget  # or the last ones would live on through these names
            self._pulse.wait(PULSE)

    def _next(self) -> list[Refreshing]:
        with self._lock:
            self._forget()
            found = list(self._widgets)
            if not found:
                self._thread = None
            return found

    def _forget(self) -> None:
        while self._left:
            widget = self._left.popleft()()
            if widget is not None:
                self._widgets.discard(widget)


PUBLISHER = Publisher()
"""The one of this process."""
