"""Saved widgets in a report: drawn by their own scripts from their own state, and nothing gets out of it."""

from __future__ import annotations

import base64
import json
import re
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_notebook, new_output

from sfkit.reports.page import NotebookRun, render_page
from sfkit.reports.widgets import STATE_MIME, VIEW_MIME

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# Shows its text and the sum of its bytes; a click changes the text in every view.
SCRIPT = """
function render({ model, el }) {
  const button = document.createElement("button");
  const bytes = model.get("held").rows[0];
  const sum = Array.from({ length: bytes.byteLength }, (_, n) => bytes.getUint8(n)).reduce((a, b) => a + b);
  const draw = () => (button.textContent = `${model.get("text")} ${sum}`);
  button.onclick = () => { model.set("text", "changed"); model.save_changes(); model.send({ any: 1 }); };
  model.on("change:text", draw);
  draw();
  el.append(button);
}
export default { render };
"""
HOSTILE = "</script><img src='http://example.org/x.png' onerror='document.title=1'>"


def widget(text: str, script: str = SCRIPT, **more: Any) -> dict[str, Any]:
    """A saved anywidget with three bytes in a list of a trait."""
    buffer = {
        "path": ["held", "rows", 0],
        "encoding": "base64",
        "data": base64.b64encode(b"\x01\x02\xff").decode(),
    }
    state = {"_esm": script, "_css": "button { color: rgb(1 2 3); }", "text": text, "held": {"rows": [None]}}
    return {"model_name": "AnyModel", "state": {**state, **more}, "buffers": [buffer]}


def box(*children: str) -> dict[str, Any]:
    """A saved box."""
    return {"model_name": "VBoxModel", "state": {"children": [f"IPY_MODEL_{name}" for name in children]}}


def executed(states: dict[str, Any], *shown: str) -> NotebookNode:
    """A notebook whose cells show widgets; each has a plain text as well."""
    cells = [
        new_code_cell(
            outputs=[
                new_output("display_data", {VIEW_MIME: {"model_id": name}, "text/plain": f"plain {name}"})
            ]
        )
        for name in shown
    ]
    notebook = new_notebook(cells=cells)
    notebook.metadata["widgets"] = {STATE_MIME: {"state": states, "version_major": 2, "version_minor": 0}}
    return notebook


def page_of(notebook: NotebookNode) -> str:
    return render_page(notebook, NotebookRun("n.ipynb", datetime.now().astimezone(), 1.0, {}, None))


def saved(page: str) -> dict[str, Any]:
    """What the page's script draws from."""
    (text,) = re.findall(r'<script type="application/json" id="saved-widgets">(.*?)</script>', page)
    found: dict[str, Any] = json.loads(text)
    return found


def test_shared_sources_are_written_once_and_only_for_what_is_shown() -> None:
    states = {"a": widget("one"), "b": widget("two"), "unseen": widget("three", "export default {}")}
    page = page_of(executed(states, "a", "b", "a"))
    found = saved(page)
    assert list(found["models"]) == ["a", "b"]
    assert found["sources"] == [SCRIPT, "button { color: rgb(1 2 3); }"]
    assert found["models"]["b"]["state"] == {"text": "two", "held": {"rows": [None]}}
    assert page.count('class="widget" data-model="a"') == 2
    assert "plain a" not in page


def test_what_cannot_be_drawn_keeps_its_text() -> None:
    states = {"slider": {"model_name": "IntSliderModel", "state": {"value": 3}}, "loop": box("loop")}
    page = page_of(executed(states, "slider", "loop", "lost"))
    for name in ("slider", "loop", "lost"):
        assert f"plain {name}" in page
    assert "saved-widgets" not in page
    assert "plain x" in page_of(NotebookNode(executed({}, "x"), metadata=NotebookNode()))


def test_boxes_hold_widgets_and_labels() -> None:
    label = {"model_name": "LabelModel", "state": {"value": "<b>waits"}}
    page = page_of(
        executed({"all": box("label", "inner"), "inner": box("a"), "a": widget("x"), "label": label}, "all")
    )
    column = '<div class="widget-box" data-direction="column">'
    inner = f'{column}<div class="widget" data-model="a"></div></div>'
    assert f"{column}<p>&lt;b&gt;waits</p>{inner}</div>" in page


@pytest.mark.browser
def test_widgets_are_drawn_without_a_network(browser: Browser, tmp_path: Path) -> None:
    states = {"a": widget(HOSTILE), "broken": widget("", "export default { render() { throw Error('no') } }")}
    states['"><i>'] = widget(
        "quoted", f"export default async () => {{ {SCRIPT.replace('export default', 'return')} }}"
    )
    path = tmp_path / "report.html"
    path.write_text(page_of(executed(states, "a", "a", '"><i>', "broken")), encoding="utf-8")
    context = browser.new_context(offline=True)
    page = context.new_page()
    asked: list[str] = []
    noise: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: noise.append(message.text))
    page.on("pageerror", lambda error: noise.append(str(error)))
    page.goto(path.as_uri())
    buttons = page.locator(".widget button")
    says = """(texts) => texts.join() ===
        [...document.querySelectorAll(".widget button")].map((button) => button.innerText).join()"""
    page.get_by_role("alert").wait_for()
    page.wait_for_function(says, arg=[f"{HOSTILE} 258", f"{HOSTILE} 258", "quoted 258"])
    assert buttons.first.evaluate("e => getComputedStyle(e).color") == "rgb(1, 2, 3)"
    assert page.get_by_role("alert").inner_text() == "This widget could not be drawn: Error: no"
    buttons.first.click()
    page.wait_for_function(says, arg=["changed 258", "changed 258", "quoted 258"])
    context.close()
    assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
    assert noise == []
