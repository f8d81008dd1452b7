"""A widget on a bare page: its script in Chromium, a fake model in place of Jupyter, no network at all."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from sfkit_widgets._base import SfkitWidget

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

MODEL = (Path(__file__).parent / "browser_model.js").read_text(encoding="utf-8")
PAGE = "<!doctype html><html lang='en'><meta charset='utf-8'><title>widget</title><body></body></html>"
PATIENCE = 240.0  # s; the machine may be busy with other things, and nothing here measures time
PULSE = 15  # ms between two looks at what the Python side has changed, as a kernel's messages would come


def _coded(value: object) -> object:
    if isinstance(value, bytes | memoryview):
        return {"$bytes": base64.b64encode(value).decode()}
    if isinstance(value, Mapping):
        return {str(key): _coded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_coded(entry) for entry in value]
    return value


def assert_becomes(page: Page, read: Callable[[], object], expected: object) -> None:
    """Assert that what ``read`` returns equals ``expected``, at once or as soon as the page has got there.

    Input events, messages and decoded pictures arrive when they arrive: neither a drawn frame nor the call
    that caused them tells that they have. Waiting goes through the page, so that its messages are served.
    """
    deadline = time.monotonic() + PATIENCE
    while (found := read()) != expected and time.monotonic() < deadline:
        page.wait_for_timeout(PULSE)
    assert found == expected, f"found {found}, expected {expected}"


def still_box(found: Locator) -> tuple[float, float, float, float]:
    """Left, top, width and height of an element that is in view, at rest, and what the mouse would meet."""
    found.hover(trial=True)
    box = found.bounding_box()
    assert box is not None
    return box["x"], box["y"], box["width"], box["height"]


def as_message(state: Mapping[str, object]) -> dict[str, Any]:
    """State as it travels to the fake model; refuses what is no JSON, such as NaN."""
    message: dict[str, Any] = json.loads(json.dumps(_coded(state), allow_nan=False))
    return message


class Stage:
    """One page with one widget.

    Attributes:
        page: Playwright's page.
        root: the widget's outermost element.
        widget: the Python side, where there is one.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.widget: SfkitWidget | None = None
        self._seen: dict[str, Any] = {}
        page.set_content(PAGE)

    @property
    def root(self) -> Locator:
        """The widget's outermost element."""
        return self.page.locator(".sfkit")

    def show_state(self, widget: SfkitWidget, **changes: object) -> None:
        """Show a widget's state alone, as a saved notebook would: nobody answers its messages."""
        state = as_message({**widget.get_state(), **changes})
        self._import("async ({ show }, state) => await show(state)", state)

    def show(self, widget: SfkitWidget) -> None:
        """Show a widget with its Python side behind it, in this process: commands are carried out."""
        self.widget = widget
        self._seen = as_message(widget.get_state())
        self.page.expose_function("sfkitSend", self._receive)
        self.page.expose_function("sfkitPull", self._changes)
        self._import(
            f"""async ({{ show }}, state) => {{
                await show(state, (content) => window.sfkitSend(content));
                const pull = async () => {{
                    window.model.push(await window.sfkitPull());
                    setTimeout(pull, {PULSE});
                }};
                pull();
            }}""",
            self._seen,
        )

    def messages(self) -> list[dict[str, Any]]:
        """What the widget has sent so far."""
        found: list[dict[str, Any]] = self.page.evaluate("window.model.messages")
        return found

    def push(self, **changes: object) -> None:
        """Change traits as the kernel would."""
        self.page.evaluate("(changes) => window.model.push(changes)", as_message(changes))

    def settled(self) -> None:
        """Wait until every command sent so far is acknowledged."""
        self.page.wait_for_function(SETTLED)

    def findings(self) -> list[str]:
        """What axe-core finds serious or critical in the widget's accessibility, a line each."""
        axe = pytest.importorskip(
            "axe_playwright_python.sync_playwright", reason="install the extra: pip install sfkit[browser]"
        )
        found = axe.Axe().run(self.page, context=".sfkit").response["violations"]
        return [
            f"{rule['id']}: {node['target']} {node['failureSummary']}"
            for rule in found
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]

    def _import(self, body: str, state: Mapping[str, object]) -> None:
        source = base64.b64encode(MODEL.encode()).decode()
        self.page.evaluate(
            f"async (state) => await ({body})(await import('data:text/javascript;base64,{source}'), state)",
            state,
        )

    def _receive(self, content: dict[str, Any]) -> None:
        assert self.widget is not None
        self.widget._receive(self.widget, content, [])

    def _changes(self) -> dict[str, Any]:
        """What has changed on the Python side since the last look."""
        assert self.widget is not None
        now = as_message(self.widget.get_state())
        changed = {name: value for name, value in now.items() if self._seen.get(name) != value}
        self._seen = now
        return changed


SETTLED = """() => {
    const { sent = "0", acknowledged = "0" } = document.querySelector(".sfkit").dataset;
    return sent === acknowledged;
}"""
"""Javascript: the first widget of the page has no command on its way."""
