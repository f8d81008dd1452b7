"""Names that are code, in everything that reaches a page: they are text, and nothing of them runs."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from sfkit.analysis import shown
from sfkit.reports.page import Failure, NotebookRun, render_page
from sfkit.reports.widgets import STATE_MIME, VIEW_MIME

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NAME = "<img src=x onerror=\"window.owned='img'\">"
RAW = (
    NAME,
    "<script>window.owned = 'inline'</script>",
    "<script src=\"data:text/javascript,window.owned='data'\"></script>",
    "<svg onload=\"window.owned='svg'\"></svg>",
    "<iframe srcdoc=\"<script>parent.owned='frame'</script>\"></iframe>",
    "<iframe src=\"data:text/html,<script>parent.postMessage('data')</script>\"></iframe>",
    "<a id=link href=\"javascript:window.owned='link'\">follow</a>",
    "<base href=http://example.org/><link rel=stylesheet href=http://example.org/a.css>",
    "<form id=form action=http://example.org/><button>send</button></form>",
    "<img src=http://example.org/pixel.png>",
)
"""What a table of pandas' own, or an author's cell, can still put into the page as markup."""
WIDGET = "export default {render({model, el}) { el.textContent = model.get('name'); }}"


def output(mime: str, data: object) -> Any:
    return new_code_cell("x", outputs=[new_output("display_data", data={mime: data})])


def hostile_page() -> str:
    table = pd.DataFrame({NAME: [NAME, 1.5]}, index=pd.Index([NAME, "b"], name=NAME)).rename_axis(
        columns=NAME
    )
    figure = {
        "data": [{"type": "scatter", "y": [1, 2], "name": NAME, "text": [NAME, NAME]}],
        "layout": {"title": {"text": NAME}, "showlegend": True, "xaxis": {"title": {"text": NAME}}},
    }
    cells = [new_markdown_cell(f"# {NAME}\n\n{NAME}")]
    cells += [output("text/html", shown(table).to_html()), output("text/html", table.to_html())]
    cells += [output("text/html", markup) for markup in RAW]
    cells += [output("text/markdown", f"# {NAME}"), output("application/vnd.plotly.v1+json", figure)]
    cells += [output(VIEW_MIME, {"model_id": "one"}), output(VIEW_MIME, {"model_id": "label"})]
    states = {
        "one": {"model_name": "AnyModel", "state": {"_esm": WIDGET, "name": NAME}},
        "label": {"model_name": "LabelModel", "state": {"value": NAME}},
    }
    book = new_notebook(cells=cells, metadata={"widgets": {STATE_MIME: {"state": states}}})
    run = NotebookRun(NAME, datetime.now(UTC), 1.0, {NAME: NAME}, Failure(1, NAME))
    return render_page(book, run)


def test_tables_for_notebooks_hold_names_as_text() -> None:
    table = pd.DataFrame({NAME: [NAME, 1.5], "n": [1.0, None]}, index=pd.Index([NAME, "b"], name=NAME))
    table.columns.name = NAME
    before = table.copy()
    markup = shown(table).to_html()
    assert "<img" not in markup
    assert markup.count("&lt;img src=x onerror=") == 5
    pd.testing.assert_frame_equal(table, before)
    assert table.index.name == table.columns.name == NAME, "the caller's table stays as it is"


def test_the_policy_names_the_scripts_that_run() -> None:
    page = hostile_page()
    policy = page.split('http-equiv="Content-Security-Policy" content="')[1].split('"')[0]
    scripts = next(part for part in policy.split("; ") if part.startswith("script-src")).split()
    assert "'unsafe-inline'" not in scripts
    (nonce,) = [word.strip("'").removeprefix("nonce-") for word in scripts if word.startswith("'nonce-")]
    assert page.count(f'<script nonce="{nonce}">') == 3, "plotly, the page's and the widgets'"
    assert nonce not in hostile_page(), "nobody can know it before"
    head = page[: page.index("<main>")]
    assert "<img" not in head


@pytest.mark.browser
def test_nothing_hostile_runs_and_all_is_drawn(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(hostile_page(), encoding="utf-8")
    context = browser.new_context()
    page = context.new_page()
    asked: list[str] = []
    heard: list[str] = []
    refused: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("requestfailed", lambda request: request.failure == "csp" and refused.append(request.url))
    page.expose_function("heard", lambda said: heard.append(said))
    page.add_init_script("addEventListener('message', (event) => heard(event.data))")
    page.goto(path.as_uri())
    page.wait_for_selector(".plot .gtitle")
    page.wait_for_function("document.querySelector('.widget').textContent.includes('onerror')")
    page.locator("#link").click()
    page.evaluate("document.querySelector('#form button').click()")
    assert page.evaluate("window.owned") is None
    assert page.url.startswith(path.as_uri())
    assert heard == []

    def beyond() -> set[str]:
        return {url for url in asked if not url.startswith(("data:", "about:", path.as_uri()))}

    for _ in range(3000):  # a refusal is told after the request
        if beyond() == set(refused):
            break
        page.wait_for_timeout(20)
    assert beyond() == set(refused), "the policy lets nothing out"
    context.close()
