"""A still beside each widget: the picture a saved notebook shows where nobody runs the widget.

JupyterLab saves widgets only where its user has asked for that; otherwise a notebook that is opened again
says "model not found" in their place. So a widget is displayed in two outputs: itself, and a picture of its
state, which is hidden while the widget is alive, and hides the message where it is not. The picture is plain
HTML with one image: it shows in viewers without widgets, too. It is renewed at the end of each cell, and
within seconds of what happens between cells.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from html import escape
from typing import Any
from weakref import WeakSet

from IPython import get_ipython
from IPython.display import publish_display_data

from sfkit_widgets._latest import Latest
from sfkit_widgets._sheet import Sheet

RENEWED_AFTER = 5.0
"""Seconds between a change and its still, outside of cells."""

STILL = "sfkit-still"
"""Class of every still; that of one also ends with its name."""

_STYLE = """
.jp-OutputArea-child:has(+ .jp-OutputArea-child .{still}) .jupyter-widgets:not(:has(*)) {{ display: none; }}
"""


class Still:
    """The picture of one widget.

    Args:
        name: of the widget's model; letters and digits.
        draw: what the widget looks like now.
    """

    def __init__(self, name: str, draw: Callable[[], Sheet]) -> None:
        self.name = name
        self._draw = draw
        self._shown = self._due = False
        self._later = Latest(RENEWED_AFTER)

    def markup(self) -> str:
        """The still as HTML."""
        sheet = self._draw()
        source = base64.b64encode(sheet.svg().encode()).decode()
        return (
            f'<div class="{STILL} {STILL}-{self.name}"><img alt="{escape(sheet.title)}, as it last looked" '
            f'style="max-width: 100%; height: auto" src="data:image/svg+xml;base64,{source}"></div>'
            f"<style>{_STYLE.format(still=f'{STILL}-{self.name}')}</style>"
        )

    def show(self) -> None:
        """Display it, in the output of the cell that runs."""
        self._publish(update=False)
        self._shown = True
        _STILLS.add(self)
        if (shell := get_ipython()) is not None and _renew_all not in shell.events.callbacks["post_run_cell"]:
            shell.events.register("post_run_cell", _renew_all)

    def changed(self) -> None:
        """The widget looks different from now on."""
        if self._shown and not self._due:
            self._due = True
            self._later.submit(self.renew)

    def renew(self) -> None:
        """Draw it anew where it was displayed and has changed since."""
        if self._due:
            self._due = False
            self._publish(update=True)

    def close(self) -> None:
        """It stays as it is."""
        self._shown = self._due = False
        self._later.cancel()

    def _publish(self, *, update: bool) -> None:
        shown = {"text/html": self.markup()}
        publish(shown, transient={"display_id": f"{STILL}-{self.name}"}, update=update)


def publish(data: Mapping[str, Any], metadata: Mapping[str, Any] | None = None, **more: Any) -> None:
    """An output by its data and metadata, each by MIME type."""
    publish_display_data(data, metadata, **more)  # type: ignore[no-untyped-call]  # IPython has no types


_STILLS: WeakSet[Still] = WeakSet()


def _renew_all(*_: object) -> None:
    """At the end of a cell, from its own thread: a run without a screen is told of nothing later."""
    for still in list(_STILLS):
        still.renew()
