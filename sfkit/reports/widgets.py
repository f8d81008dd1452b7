"""Widgets in a report: their last state, drawn by their own scripts, without a kernel or a network.

An executed notebook carries the state of its widgets, and a single-file anywidget carries its script and
style sheet in that state. ``widgets.js`` runs these on a model that has this state and no one behind it. Of
other widgets, boxes are laid out and labels written; what else there is keeps its plain text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

from nbformat import NotebookNode

from sfkit.reports.text import escaped

VIEW_MIME = "application/vnd.jupyter.widget-view+json"
STATE_MIME = "application/vnd.jupyter.widget-state+json"
STILL = '<div class="sfkit-still'
"""How the picture begins that stands beside a widget where it cannot be drawn."""

DIRECTIONS = {"VBoxModel": "column", "HBoxModel": "row"}
REFERENCE = "IPY_MODEL_"
SOURCES = {"_esm": "script", "_css": "style"}
"""Parts of the state that many widgets of a page share; each is written once."""


class SavedWidgets:
    """The saved widgets of a notebook, and which of them a page shows.

    Args:
        notebook: an executed notebook; one without widgets is fine.
    """

    def __init__(self, notebook: NotebookNode) -> None:
        saved = notebook.metadata.get("widgets", {}).get(STATE_MIME, {})
        self._saved: Mapping[str, Mapping[str, Any]] = saved.get("state", {})
        self._placed: dict[str, Mapping[str, Any]] = {}

    def markup(self, view: Mapping[str, Any]) -> str:
        """Where the widget of an output is drawn; empty where nothing is saved that could be.

        Args:
            view: an output's data of type ``VIEW_MIME``.
        """
        return self._place(str(view.get("model_id")), frozenset())

    @property
    def placed(self) -> bool:
        """Whether any widget was given a place."""
        return bool(self._placed)

    def scripts(self) -> tuple[str, ...]:
        """What draws all widgets that were given a place; empty where there is none."""
        if not self._placed:
            return ()
        return (resources.files("sfkit.reports").joinpath("widgets.js").read_text(encoding="utf-8"),)

    def state(self) -> str:
        """The state it draws, as HTML; empty where there is none."""
        if not self._placed:
            return ""
        sources: dict[str, int] = {}
        models = {}
        for identity, entry in self._placed.items():
            state = {name: value for name, value in entry["state"].items() if name not in SOURCES}
            known = {name: text for name, text in entry["state"].items() if name in SOURCES and text}
            # Widgets of one kind share their code, which the page holds once.
            shared = {SOURCES[name]: sources.setdefault(text, len(sources)) for name, text in known.items()}
            models[identity] = {"state": state, "buffers": entry.get("buffers", []), **shared}
        # Inside a script element only "<" could end it.
        text = json.dumps({"sources": list(sources), "models": models}).replace("<", "\\u003c")
        return f'<script type="application/json" id="saved-widgets">{text}</script>'

    def _place(self, identity: str, above: frozenset[str]) -> str:
        entry = self._saved.get(identity)
        if entry is None or identity in above:  # a box cannot hold itself, whatever a file says
            return ""
        state, kind = entry["state"], entry.get("model_name")
        if state.get("_esm"):
            self._placed[identity] = entry
            return f'<div class="widget" data-model="{escaped(identity)}"></div>'
        if kind == "LabelModel" and state.get("value"):
            return f"<p>{escaped(state['value'])}</p>"
        if kind not in DIRECTIONS:
            return ""
        names = [str(child).removeprefix(REFERENCE) for child in state.get("children", [])]
        parts = "".join(self._place(name, above | {identity}) for name in names)
        return parts and f'<div class="widget-box" data-direction="{DIRECTIONS[kind]}">{parts}</div>'
