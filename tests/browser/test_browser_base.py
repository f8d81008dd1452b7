"""What all widgets share, in a browser: theme, alert, commands and their acknowledgement, clean-up."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browser_lab import Notebook
from browser_probe import Probe
from browser_stage import Stage, assert_becomes

pytestmark = pytest.mark.browser

Open = Callable[..., Stage]
Opened = Callable[..., Notebook]
CELLS = ["from browser_probe import Probe\nprobe = Probe()\nprobe"]


def wait_for_theme(stage: Stage, theme: str, host: str) -> None:
    """Until the widget shows a theme, and whose it is."""
    stage.page.wait_for_selector(f".sfkit[data-theme='{theme}'][data-host='{host}']")


@pytest.mark.parametrize("dark", [False, True])
def test_the_browser_s_preference_decides_where_no_host_does(stage: Open, dark: bool) -> None:
    shown = stage(dark=dark)
    shown.show_state(Probe())
    wait_for_theme(shown, "dark" if dark else "light", "browser")
    shown.page.emulate_media(color_scheme="light" if dark else "dark")
    wait_for_theme(shown, "light" if dark else "dark", "browser")


def test_the_host_s_theme_is_followed(stage: Open) -> None:
    shown = stage()
    shown.show_state(Probe())
    body = "document.body"
    shown.page.evaluate(f"{body}.classList.add('vscode-dark')")
    wait_for_theme(shown, "dark", "vscode")
    shown.page.evaluate(f"{body}.className = 'vscode-high-contrast vscode-high-contrast-light'")
    wait_for_theme(shown, "light", "vscode")
    shown.page.evaluate(f"{body}.className = ''; document.documentElement.setAttribute('theme', 'dark')")
    wait_for_theme(shown, "dark", "colab")
    shown.page.evaluate(f"{body}.dataset.jpThemeLight = 'true'")
    wait_for_theme(shown, "light", "jupyter")


def test_a_theme_that_was_asked_for_stays(stage: Open) -> None:
    shown = stage(dark=True)
    shown.show_state(Probe(theme="light"))
    wait_for_theme(shown, "light", "other")
    shown.push(theme="dark")
    wait_for_theme(shown, "dark", "browser")


def test_commands_are_carried_out_and_acknowledged(stage: Open) -> None:
    shown = stage()
    shown.show(Probe(start=5))
    shown.root.get_by_role("button", name="add").click()
    assert_becomes(shown.page, shown.root.locator("output").inner_text, "7")
    assert_becomes(shown.page, lambda: shown.root.get_attribute("data-acknowledged"), "1")


def test_of_a_drag_the_first_and_the_last_are_sent(stage: Open) -> None:
    shown = stage()
    shown.show(Probe())
    shown.root.get_by_role("button", name="drag").click()
    assert_becomes(shown.page, shown.root.locator("output").inner_text, "5")
    shown.settled()
    assert [message["arguments"]["number"] for message in shown.messages()] == [1, 4]


def test_an_error_is_an_alert_until_it_is_over(stage: Open) -> None:
    shown = stage()
    shown.show_state(Probe())
    alert = shown.root.get_by_role("alert")
    assert_becomes(shown.page, alert.count, 0)
    shown.push(error="<b>weights.pth</b>: no such file")
    assert_becomes(shown.page, alert.inner_text, "<b>weights.pth</b>: no such file")
    shown.push(error="")
    assert_becomes(shown.page, alert.count, 0)


def test_without_a_kernel_the_last_state_shows_and_says_what_to_do(stage: Open) -> None:
    shown = stage()
    shown.show_state(Probe(), total=42)
    assert_becomes(shown.page, shown.root.locator("output").inner_text, "42")
    shown.root.get_by_role("button", name="add").click()
    shown.page.wait_for_selector(".sfkit-waiting:has-text('run the cell that makes this widget')")


def test_after_a_restart_of_the_kernel_it_says_at_once_what_to_do(stage: Open) -> None:
    shown = stage()
    shown.show_state(Probe(), total=42)
    shown.page.evaluate("() => { window.model.send = () => { throw new Error('Cannot send'); }; }")
    shown.root.get_by_role("button", name="add").click()
    shown.page.wait_for_selector(".sfkit-waiting:has-text('after a restart of the kernel')")


def test_nothing_listens_after_the_view_is_closed(stage: Open) -> None:
    shown = stage()
    shown.show_state(Probe())
    assert shown.page.evaluate("window.model.listening") > 0
    shown.page.evaluate("window.close()")
    assert shown.page.evaluate("window.model.listening") == 0
    shown.root.get_by_role("button", name="add").click()
    assert shown.messages() == []


def test_in_jupyterlab(lab: Opened) -> None:
    notebook = lab("base/probe.ipynb", CELLS)
    notebook.run_all()
    root = notebook.page.locator(".sfkit")
    root.get_by_role("button", name="add").click()
    assert_becomes(notebook.page, root.locator("output").inner_text, "2")
    assert_becomes(notebook.page, lambda: notebook.evaluate("probe.total"), 2)
    notebook.settled()
    notebook.theme("JupyterLab Dark")
    notebook.page.wait_for_selector(".sfkit[data-theme='dark'][data-host='jupyter']")
    notebook.theme("JupyterLab Light")
    notebook.page.wait_for_selector(".sfkit[data-theme='light'][data-host='jupyter']")
    notebook.save()
    notebook.reload()
    root.get_by_role("button", name="add").click()
    assert_becomes(notebook.page, root.locator("output").inner_text, "4")
    notebook.settled()


def test_in_notebook_7(notebook7: Opened) -> None:
    notebook = notebook7("base/probe7.ipynb", CELLS)
    notebook.run_all()
    notebook.page.locator(".sfkit").get_by_role("button", name="add").click()
    assert_becomes(notebook.page, notebook.page.locator(".sfkit output").inner_text, "2")
