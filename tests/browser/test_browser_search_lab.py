"""A search in JupyterLab: commanded while the kernel answers, watched from elsewhere, unharmed by reloads."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browser_lab import Notebook
from browser_stage import assert_becomes

pytestmark = pytest.mark.browser

Opened = Callable[..., Notebook]
CELLS = [
    "from browser_search import subset_search\n"
    "from sfkit_widgets import PopulationView, SearchControl\n"
    "search, scorer = subset_search(journal='journal.jsonl')",
    "control = SearchControl(search)\ncontrol",
    "view = PopulationView(search)\nview",
]
WATCH = ["import sfkit_widgets\nwatched = sfkit_widgets.watch('.')\nwatched"]


def press(notebook: Notebook, name: str) -> None:
    """Click a button of the control; its command is acknowledged."""
    notebook.page.locator(".sfkit-control").get_by_role("button", name=name).click()
    notebook.settled()


def wait_for_phase(notebook: Notebook, phase: str) -> None:
    notebook.page.wait_for_selector(f".sfkit-control-phase[data-phase='{phase}']")


def wait_for_generation(notebook: Notebook, generation: int) -> None:
    """Until both widgets show it."""
    shown = f".sfkit-control [data-figure='generation']:text-is('{generation} of 5')"
    notebook.page.wait_for_selector(shown)
    notebook.page.wait_for_selector(f".sfkit-population-which:has-text('{generation} of {generation}')")


def pass_gate(notebook: Notebook, generations: int = 1) -> None:
    """Let generations pass, by asking the kernel, which answers while the search runs."""
    assert notebook.evaluate(f"scorer.open({generations})") is None


def test_a_search_is_run_paused_stepped_and_stopped_in_jupyterlab(lab: Opened) -> None:
    notebook = lab("search/control.ipynb", CELLS)
    notebook.run_all()
    press(notebook, "One step")
    wait_for_phase(notebook, "running")
    assert notebook.evaluate("6 * 7") == 42
    pass_gate(notebook)
    wait_for_phase(notebook, "paused")
    wait_for_generation(notebook, 0)

    press(notebook, "Run")
    wait_for_phase(notebook, "running")
    pass_gate(notebook)
    wait_for_generation(notebook, 1)
    notebook.command("notebook:interrupt-kernel")
    notebook.save()
    pass_gate(notebook)
    notebook.page.close()
    notebook = lab("search/control.ipynb")
    notebook.back()
    wait_for_phase(notebook, "running")
    wait_for_generation(notebook, 2)

    assert notebook.evaluate("scorer.inside.wait(300)")
    press(notebook, "Pause")
    wait_for_phase(notebook, "pausing")
    pass_gate(notebook)
    wait_for_phase(notebook, "paused")
    notebook.theme("JupyterLab Dark")
    notebook.page.wait_for_selector(".sfkit-population[data-theme='dark']")

    elsewhere = lab("search/watch.ipynb", WATCH)
    elsewhere.run_all()
    wait_for_generation(elsewhere, 3)
    assert_becomes(elsewhere.page, elsewhere.page.locator(".sfkit-control-buttons").is_hidden, True)

    notebook.save()
    notebook.reload()
    wait_for_generation(notebook, 3)
    press(notebook, "One step")
    pass_gate(notebook)
    wait_for_phase(notebook, "paused")
    wait_for_generation(notebook, 4)
    wait_for_generation(elsewhere, 4)

    press(notebook, "Stop")
    wait_for_phase(notebook, "stopped")
    elsewhere.page.wait_for_selector(".sfkit-control-phase[data-phase='stopped']")
    press(notebook, "Run")
    pass_gate(notebook, 10)
    wait_for_phase(notebook, "finished")
    wait_for_generation(notebook, 5)
    said = "[search.done, control.error, view.error]"
    assert_becomes(notebook.page, lambda: notebook.evaluate(said), [True, "", ""])
