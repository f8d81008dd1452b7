"""DisparityCompare in JupyterLab: linked zoom, another pair, reload, dark theme."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browser_lab import Notebook
from browser_stage import assert_becomes, still_box

pytestmark = pytest.mark.browser

CELLS = [
    "from pathlib import Path\nimport tempfile\nfrom browser_compare import widget",
    "compare = widget(Path(tempfile.mkdtemp()))\ncompare",
]
KEPT = ".sfkit[data-kept='true']"


def test_in_jupyterlab(lab: Callable[..., Notebook]) -> None:
    notebook = lab("compare/compare.ipynb", CELLS)
    notebook.run_all()
    page = notebook.page
    root = page.locator(".sfkit")
    panels = root.locator("canvas")
    assert_becomes(page, panels.count, 5)
    panels.nth(2).click()
    left, top, width, height = still_box(panels.nth(2))
    page.mouse.move(left + width / 4, top + height / 2)
    page.mouse.wheel(0, -120)
    zoom = root.locator("output").inner_text
    assert_becomes(page, zoom, "120 %")
    page.wait_for_selector(KEPT)
    # The point under the mouse, at a quarter of the width, stays there.
    camera = "[compare.camera.get(name, 0) for name in ('zoom', 'x')]"
    expected = [pytest.approx(1.2), pytest.approx(24 + 96 / 1.2 / 4, abs=0.5)]
    assert_becomes(page, lambda: notebook.evaluate(camera), expected)
    root.get_by_role("button", name="next pair").click()
    page.wait_for_selector(".sfkit[data-pair='pair1']")
    assert_becomes(page, lambda: notebook.evaluate("compare.scene['pair']"), "pair1")
    notebook.settled()
    panels.nth(2).click()
    page.keyboard.press("2")
    page.keyboard.press("+")
    assert_becomes(page, zoom, "120 %")
    page.wait_for_selector(KEPT)
    notebook.theme("JupyterLab Dark")
    page.wait_for_selector(".sfkit[data-theme='dark'][data-host='jupyter']")
    notebook.theme("JupyterLab Light")
    notebook.still_says("Networks on pair pair1 of pairs")
    notebook.save()
    notebook.reload()
    page.wait_for_selector(".sfkit[data-pair='pair1']")
    page.wait_for_selector("button[data-value='error'][aria-pressed='true']")
    assert_becomes(page, zoom, "120 %")
    root.get_by_role("button", name="previous pair").click()
    page.wait_for_selector(".sfkit[data-pair='pair0']")
