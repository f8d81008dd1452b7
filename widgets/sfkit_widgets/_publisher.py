"""One thread that looks, about eight times a second, whether there is something new to show."""

from __future__ import annotations

import threading
from typing import Protocol
from weakref import WeakSet

PULSE = 0.125
"""Seconds between two looks: more often than that is not seen, and would slow the search down."""


class Refreshing(Protocol):
    """A widget that can bring its traits up to date."""

    def refresh(self) -> None:
        """Show what is new; cheap where nothing is, and never raises."""


class Publisher:
    """Refreshes widgets from one daemon thread, until they are closed or gone."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._widgets: WeakSet[Refreshing] = WeakSet()
        self._thread: threading.Thread | None = None
        self._pulse = threading.Event()

    def follow(self, widget: Refreshing) -> None:
        """Refresh a widget from now on."""
        with self._lock:
            self._widgets.add(widget)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="sfkit widgets", daemon=True)
                self._thread.start()

    def leave(self, widget: Refreshing) -> None:
        """Refresh it no longer."""
        with self._lock:
            self._widgets.discard(widget)

    def _work(self) -> None:
        while widgets := self._followed():
            for widget in widgets:
                widget.refresh()
            del widgets, widget  # or the last ones would live on through these names
            self._pulse.wait(PULSE)

    def _followed(self) -> list[Refreshing]:
        with self._lock:
            found = list(self._widgets)
            if not found:
                self._thread = None
            return found


PUBLISHER = Publisher()
"""The one of this process."""
