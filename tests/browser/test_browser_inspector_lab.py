"""The RoutingInspector in JupyterLab and Notebook 7: live, beside a busy cell, reloaded, without a kernel."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browser_lab import Notebook
from browser_stage import assert_becomes, still_box

pytestmark = pytest.mark.browser

Opened = Callable[..., Notebook]

MAKE = """
from pathlib import Path
import time, tiny, sfkit
from sfkit_widgets import RoutingInspector
folder = Path("world")
path = folder / "pool.toml"
pool = sfkit.open_pool(path if path.exists() else tiny.write_pool(folder))
pairs = tiny.write_pairs(folder / "pairs")
scorer = sfkit.Evaluator(pool, sfkit.open_benchmark("pairs", pairs, metric="bad-2.0"))
stage2 = sfkit.RoutingSearch(
    pool.names, pool.blocks, scorer, sfkit.RoutingSettings(evaluations=9, population=4, tied=False)
)
best = stage2.run()
"""
SHOW = "inspector = RoutingInspector(scorer, search=stage2)\ninspector"
BUSY = "while inspector.scales[1] != 0.5:\n    time.sleep(0.05)\nprint('left')"


def drag(notebook: Notebook, label: str, up: float) -> None:
    """Drag a weight upwards by some pixels, from what it is when all before is done."""
    notebook.settled()
    left, top, width, height = still_box(notebook.page.locator(f"[role=gridcell][aria-label^='{label}:']"))
    x, y = left + width / 2, top + height / 2
    notebook.page.mouse.move(x, y)
    notebook.page.mouse.down()
    notebook.page.mouse.move(x, y - up, steps=5)
    notebook.page.mouse.up()


def assert_weighs(notebook: Notebook, block: str, expected: dict[str, float]) -> None:
    """Assert that the kernel's recipe comes to have these weights in a block, whatever others it has."""

    def held() -> dict[str, float]:
        found: dict[str, float] = notebook.evaluate(f"inspector.recipe.of({block!r})[0]")
        return {name: found[name] for name in expected}

    assert_becomes(notebook.page, held, pytest.approx(expected))
    notebook.settled()


def test_in_jupyterlab(lab: Opened) -> None:
    notebook = lab("inspector/live.ipynb", [MAKE, SHOW])
    notebook.run_all()
    root = notebook.page.locator(".sfkit-inspector")
    root.get_by_role("button", name="Equal weights").click()
    assert_weighs(notebook, "neck", {"a": 1 / 3, "b": 1 / 3, "c": 1 / 3})
    drag(notebook, "neck, a", up=32)
    assert_weighs(notebook, "neck", {"a": 8 / 15, "b": 3.5 / 15, "c": 3.5 / 15})
    root.locator("[role=gridcell][aria-label^='head, b:']").focus()
    for key in ("0", ".", "8", "Enter"):
        notebook.page.keyboard.press(key)
    assert_weighs(notebook, "head", {"b": 0.8})
    count = notebook.page.evaluate("window.jupyterapp.shell.currentWidget.content.widgets.length")
    assert count == 2, "JupyterLab did not take a key for its own"
    notebook.page.keyboard.press("Control+z")
    assert_weighs(notebook, "head", {"b": 1 / 3})
    root.get_by_role("slider", name="Trial of the search").press("End")
    last = "inspector.recipe == stage2.candidates[-1].recipe"
    assert_becomes(notebook.page, lambda: notebook.evaluate(last), True)
    root.locator(".trial-words:has-text('trial 8 of 0 to 8')").wait_for()
    notebook.settled()
    notebook.theme("JupyterLab Dark")
    notebook.page.wait_for_selector(".sfkit-inspector[data-theme='dark']")
    notebook.theme("JupyterLab Light")
    weights = root.get_by_role("grid").inner_text()
    notebook.save()
    notebook.reload()
    notebook.page.wait_for_selector(".sfkit-inspector [role=gridcell]")
    assert_becomes(notebook.page, root.get_by_role("grid").inner_text, weights)
    drag(notebook, "neck, a", up=400)
    # The widget is live again.
    assert_weighs(notebook, "neck", {"a": 1.0})


def test_the_widget_answers_beside_a_busy_cell(lab: Opened) -> None:
    """Newer kernels deliver a widget's messages only when the cell ends: this would wait forever."""
    notebook = lab("inspector/busy.ipynb", [MAKE, SHOW, BUSY])
    for number in (0, 1):
        notebook.run_cell(number)
        notebook.ran(number)
    notebook.run_cell(2)
    notebook.page.wait_for_function(
        "() => window.jupyterapp.shell.currentWidget.content.widgets[2].model.executionState === 'running'"
    )
    number = notebook.page.locator(".sfkit-inspector").get_by_role("spinbutton", name="Module scale of neck")
    number.fill("0.5")
    number.press("Enter")
    notebook.ran(2)
    assert_becomes(notebook.page, notebook.page.get_by_text("left", exact=True).count, 1)


def test_a_saved_notebook_shows_the_last_state_without_a_kernel(lab: Opened) -> None:
    """As JupyterLab comes: it saves no widgets, and says so where one was; the still stands there instead."""
    notebook = lab("inspector/saved.ipynb", [MAKE, SHOW])
    notebook.run_all()
    drag(notebook, "neck, a", up=400)
    notebook.still_says("1.00")
    notebook.save()
    notebook.server.end_kernels()
    again = lab("inspector/saved.ipynb")
    again.page.wait_for_selector(".jupyter-widgets:has-text('model not found')", state="attached")
    still = again.page.locator(".sfkit-still img")
    still.wait_for()
    again.page.wait_for_function("() => document.querySelector('.sfkit-still img').naturalWidth === 960")
    again.page.get_by_text("model not found").wait_for(state="hidden")
    assert_becomes(again.page, lambda: still.get_attribute("alt"), "Routing inspector, as it last looked")


def test_in_notebook_7(notebook7: Opened) -> None:
    notebook = notebook7("inspector/seven.ipynb", [MAKE, SHOW])
    notebook.run_all()
    notebook.page.locator(".sfkit-inspector").get_by_role("button", name="Equal weights").click()
    assert_weighs(notebook, "neck", {"a": 1 / 3})
    drag(notebook, "neck, a", up=32)
    assert_weighs(notebook, "neck", {"a": 8 / 15})
