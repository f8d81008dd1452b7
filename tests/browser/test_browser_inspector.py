"""The RoutingInspector under mouse and keyboard: its script in Chromium, its Python side in this process."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from browser_stage import Stage, assert_becomes, still_box
from sfkit_widgets import RoutingInspector
from tiny import write_pairs, write_pool

import sfkit
from sfkit.analysis import previews

pytestmark = pytest.mark.browser

Open = Callable[..., Stage]


@pytest.fixture(scope="module")
def evaluator(tmp_path_factory: pytest.TempPathFactory) -> sfkit.Evaluator:
    folder: Path = tmp_path_factory.mktemp("world")
    pool = sfkit.open_pool(write_pool(folder / "pool"))
    return sfkit.Evaluator(
        pool, sfkit.open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0")
    )


@pytest.fixture(scope="module")
def search(evaluator: sfkit.Evaluator) -> sfkit.RoutingSearch:
    settings = sfkit.RoutingSettings(evaluations=9, population=4, tied=False)
    search = sfkit.RoutingSearch(("a", "b", "c"), evaluator.pool.blocks, evaluator, settings)
    search.run()
    return search


@pytest.fixture(autouse=True)
def no_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures at full size at once, however busy the machine is."""
    monkeypatch.setattr(previews, "QUICK_SECONDS", math.inf)


@pytest.fixture
def shown(stage: Open, evaluator: sfkit.Evaluator) -> Stage:
    """An inspector of three sources on a bare page."""
    page = stage()
    page.show(RoutingInspector(evaluator, tied=False))
    return page


def inspector(shown: Stage) -> RoutingInspector:
    """The Python side."""
    assert isinstance(shown.widget, RoutingInspector)
    return shown.widget


def weights(shown: Stage) -> list[list[str]]:
    """What the cells say, row by row."""
    return [
        row.locator("[role=gridcell]").all_inner_texts()
        for row in shown.root.locator("[role=row]:has([role=gridcell])").all()
    ]


def assert_weights(shown: Stage, expected: list[list[str]], rows: slice = slice(None)) -> None:
    """Assert that the cells of some rows come to say ``expected``."""
    assert_becomes(shown.page, lambda: weights(shown)[rows], expected)


def assert_holds(shown: Stage, read: Callable[[RoutingInspector], object], expected: object) -> None:
    """Assert that the Python side comes to hold ``expected``."""
    assert_becomes(shown.page, lambda: read(inspector(shown)), expected)


def painted(shown: Stage) -> None:
    """Wait until the pictures of the last acknowledged command are there."""
    shown.settled()
    shown.page.wait_for_function(
        "() => (({ sent = '0', painted }) => sent === painted)(document.querySelector('.sfkit').dataset)"
    )


def pixels(shown: Stage, caption: str) -> str:
    """A picture as a data URI."""
    found: str = (
        shown.root.get_by_role("figure")
        .filter(has_text=caption)
        .locator("img")
        .evaluate(
            """async (image) => {
            // The widget may exchange the picture while it is decoded.
            for (let tries = 0; tries < 100; tries += 1) {
                try { await image.decode(); break; } catch { await new Promise(requestAnimationFrame); }
            }
            await image.decode();
            const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext("2d");
            canvas.drawImage(image, 0, 0);
            return String(canvas.getImageData(0, 0, image.naturalWidth, image.naturalHeight).data);
        }"""
        )
    )
    return found


def cell(shown: Stage, block: str, source: str) -> str:
    """A selector of one weight."""
    return f"[role=gridcell][aria-label^='{block}, {source}:']"


def test_dragging_a_weight_moves_its_row_and_the_pictures(shown: Stage) -> None:
    painted(shown)
    shows = ("disparity", "error", "ground truth")
    before = [pixels(shown, caption) for caption in shows]
    left, top, width, height = still_box(shown.page.locator(cell(shown, "neck", "a")))
    x, y = left + width / 2, top + height / 2
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x, y - 32, steps=4)
    shown.page.mouse.up()
    # A third, and 32 of 160 pixels.
    assert_weights(shown, [["0.33", "0.33", "0.33"], ["0.53", "0.23", "0.23"]], slice(2))
    painted(shown)

    def same() -> list[bool]:
        return [pixels(shown, caption) == old for caption, old in zip(shows, before, strict=True)]

    assert_becomes(shown.page, same, [False, False, True])
    shown.root.get_by_role("button", name="Undo").click()
    # A drag is undone as one.
    assert_weights(shown, [["0.33", "0.33", "0.33"]] * 4)
    assert inspector(shown).error == ""


def test_a_click_edits_nothing_and_selects(shown: Stage) -> None:
    shown.page.locator(cell(shown, "neck", "b")).click()
    assert_becomes(shown.page, shown.root.get_by_role("button", name="Lock b in neck").is_enabled, True)
    assert shown.messages() == []


@pytest.mark.parametrize("typed", ["0.8", ",8", "80%"])
def test_typing_a_weight(shown: Stage, typed: str) -> None:
    shown.page.locator(cell(shown, "neck", "a")).focus()
    shown.page.keyboard.type(typed)
    shown.page.keyboard.press("Enter")
    assert_weights(shown, [["0.80", "0.10", "0.10"]], slice(1, 2))
    focused = "document.activeElement.getAttribute('aria-label')"
    assert_becomes(shown.page, lambda: shown.page.evaluate(focused), "neck, a: 0.800")


def test_what_is_no_weight_is_not_taken(shown: Stage) -> None:
    shown.page.locator(cell(shown, "neck", "a")).dblclick()
    field = shown.root.get_by_role("textbox", name="Weight of a in neck")
    field.fill("1.2")
    field.press("Enter")
    assert_becomes(shown.page, lambda: field.get_attribute("aria-invalid"), "true")
    shown.page.wait_for_selector("[aria-live]:has-text('type a number from 0 to 1')", state="attached")
    field.press("Escape")
    assert_weights(shown, [["0.33", "0.33", "0.33"]] * 4)
    assert shown.messages() == []


def test_everything_by_keyboard(shown: Stage) -> None:
    keys = shown.page.keyboard
    shown.page.locator("[role=grid] [tabindex='0']").focus()
    for key in ("ArrowDown", "ArrowRight", "+"):
        keys.press(key)
    neck = slice(1, 2)
    assert_weights(shown, [["0.31", "0.38", "0.31"]], neck)
    keys.press("Shift+_")
    keys.press("l")
    shown.root.get_by_label("neck, b: 0.373, locked", exact=True).wait_for()
    keys.press("ArrowLeft")
    keys.press("Delete")
    assert_weights(shown, [["0.00", "0.37", "0.63"]], neck)
    for _ in range(3):
        keys.press("ArrowUp")
    keys.press("Enter")
    assert_becomes(shown.page, lambda: [row[0] for row in weights(shown)], ["–"] * 4)
    keys.press("Control+z")
    keys.press("Control+z")
    assert_weights(shown, [["0.31", "0.37", "0.31"]], neck)
    keys.press("Control+y")
    assert_weights(shown, [["0.00", "0.37", "0.63"]], neck)
    # The grid is one stop of the Tab key.
    assert_becomes(shown.page, shown.page.locator("[role=grid] [tabindex='0']").count, 1)


def test_keys_that_come_faster_than_the_network_runs_all_count(shown: Stage) -> None:
    struck = """(element, [key, times]) => {
        element.focus();
        for (let n = 0; n < times; n += 1)
            element.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
    }"""
    shown.page.locator(cell(shown, "neck", "a")).evaluate(struck, ["+", 4])
    assert_holds(shown, lambda held: held.weights[1][0], pytest.approx(1 / 3 + 4 * 0.05))
    slider = shown.root.get_by_role("slider", name="Module scale of neck")
    slider.evaluate(struck, ["ArrowRight", 5])
    assert_holds(shown, lambda held: held.scales[1], pytest.approx(1.25))
    assert_becomes(shown.page, lambda: float(slider.input_value()), pytest.approx(1.25))
    sent = [message["command"] for message in shown.messages()]
    assert sent == ["weigh", "weigh", "scale", "scale"], "of a row of keys the first and the last"
    weight = shown.page.locator(cell(shown, "head", "b"))
    weight.evaluate(struck, ["+", 3])
    weight.evaluate(struck, ["l", 1])
    assert_holds(shown, lambda held: held.locked[3][1], True)
    assert inspector(shown).weights[3][1] == pytest.approx(1 / 3 + 3 * 0.05), "before the lock"
    assert inspector(shown).error == ""


def test_a_locked_weight_stays_and_cannot_be_dragged(shown: Stage) -> None:
    shown.page.locator(cell(shown, "head", "c")).click()
    shown.root.get_by_role("button", name="Lock c in head").click()
    assert_holds(shown, lambda held: held.locked[3][2], True)
    shown.settled()
    shown.page.locator(cell(shown, "head", "c")).drag_to(shown.page.locator(cell(shown, "neck", "c")))
    shown.page.locator(cell(shown, "head", "a")).focus()
    shown.page.keyboard.type("0.6\n")
    assert_weights(shown, [["0.60", "0.07", "0.33"]], slice(3, 4))
    assert [message["command"] for message in shown.messages()] == ["lock", "weigh"]


def test_what_if_a_source_were_gone(shown: Stage) -> None:
    name = shown.root.locator(".grid-source", has_text="b")
    assert_becomes(shown.page, lambda: name.get_attribute("aria-label"), "b")
    name.click()
    assert_weights(shown, [["0.50", "–", "0.50"]] * 4)
    assert_becomes(shown.page, lambda: name.get_attribute("aria-label"), "b, taken out")
    name.click()
    assert_weights(shown, [["0.33", "0.33", "0.33"]] * 4)


def test_scales_by_mouse_keyboard_and_number(shown: Stage) -> None:
    painted(shown)
    before = pixels(shown, "disparity")
    slider = shown.root.get_by_role("slider", name="Module scale of neck, 0.25 to 1.75")
    *_, width, height = still_box(slider)
    slider.click(position={"x": width - 1, "y": height / 2})
    assert_holds(shown, lambda held: held.scales[1], pytest.approx(1.75))
    assert_becomes(shown.page, lambda: pixels(shown, "disparity") != before, True)
    slider.press("ArrowLeft")
    assert_holds(shown, lambda held: held.scales[1], pytest.approx(1.7))
    number = shown.root.get_by_role("spinbutton", name="Module scale of neck")
    number.fill("0.5")
    # What Python says meanwhile does not take away what is being typed.
    inspector(shown).scale("neck", 1.3)
    assert_becomes(shown.page, lambda: slider.get_attribute("aria-valuetext"), "1.30")
    number.press("Enter")
    assert_holds(shown, lambda held: held.scales[1], 0.5)
    assert_becomes(shown.page, lambda: slider.get_attribute("aria-valuetext"), "0.50")
    shown.settled()
    number.fill("3")
    number.press("Enter")
    said = "scale of 'neck': found 3, expected it from 0.25 to 1.75"
    assert_becomes(shown.page, shown.root.get_by_role("alert").inner_text, said)
    # What was refused gives way to the scale that holds.
    assert_becomes(shown.page, number.input_value, "0.50")
    left, *_, height = still_box(slider)
    centre = shown.root.locator(".scale-ticks i").nth(1).bounding_box()
    assert centre is not None
    slider.click(position={"x": centre["x"] - left + 2, "y": height / 2})
    # The neutral mark catches the slider.
    assert_holds(shown, lambda held: held.scales[1], 1.0)


def test_scrubbing_the_trials_of_a_search(
    stage: Open, evaluator: sfkit.Evaluator, search: sfkit.RoutingSearch
) -> None:
    shown = stage()
    shown.show(RoutingInspector(evaluator, search=search))
    slider = shown.root.get_by_role("slider", name="Trial of the search")
    words = shown.root.locator(".trial-words")
    the_best = "(slider) => (slider.getAttribute('aria-valuetext') ?? '').includes('the best')"
    assert_becomes(shown.page, lambda: slider.evaluate(the_best), True)
    slider.press("Home")
    assert_weights(shown, [["0.33", "0.33", "0.33"]] * 4)
    first = "trial 0 of 0 to 8, iteration 0: bad-2.0 "
    assert_becomes(shown.page, lambda: words.inner_text().startswith(first), True)
    slider.press("ArrowRight")
    assert_holds(shown, lambda held: held.recipe, search.candidates[1].recipe)
    shown.root.get_by_role("button", name="Best").click()
    assert search.best is not None
    assert_holds(shown, lambda held: held.recipe, search.best.recipe)
    shown.root.get_by_role("button", name="Equal weights").click()
    words.filter(has_text="edited by hand").wait_for()


def test_without_a_search_there_is_nothing_to_scrub(shown: Stage) -> None:
    shown.page.locator(cell(shown, "neck", "a")).wait_for()
    assert_becomes(shown.page, shown.root.get_by_role("slider", name="Trial of the search").count, 0)


def test_pins_are_compared_and_blinked(shown: Stage) -> None:
    shown.root.get_by_role("button", name="Pin A").click()
    shown.page.locator(cell(shown, "neck", "a")).focus()
    shown.page.keyboard.type("1\n")
    assert_weights(shown, [["1.00", "0.00", "0.00"]], slice(1, 2))
    shown.settled()
    shown.root.get_by_role("button", name="Score on all 2 pairs of pairs").click()
    assert_holds(shown, lambda held: held.scores["state"], "known")
    score = f"{inspector(shown).scores['value']:.2f} %"
    live = shown.root.locator("[aria-live]")
    assert_becomes(shown.page, live.inner_text, f"pairs: bad-2.0 {score}")
    shown.root.get_by_role("button", name="Pin B").click()
    shown.root.get_by_role("table").filter(has_text=score).filter(has_text="the same").wait_for()
    painted(shown)
    edited = pixels(shown, "disparity")
    shown.root.get_by_role("button", name="A", exact=True).click()
    shown.page.wait_for_selector("figcaption:has-text('disparity of A')")
    assert_becomes(shown.page, lambda: pixels(shown, "disparity of A") != edited, True)
    shown.root.get_by_role("button", name="Blink").click()
    for name in ("B", "A", "B"):
        shown.page.wait_for_selector(f"figcaption:has-text('disparity of {name}')")
    shown.root.get_by_role("button", name="Blink").click()
    assert_becomes(shown.page, shown.root.locator("figcaption", has_text="of ").count, 0)
    for name in "AB":
        shown.root.get_by_role("button", name=f"Unpin {name}").click()
    shown.settled()
    assert_becomes(shown.page, shown.root.get_by_role("button", name="Blink").is_visible, False)


def test_another_pair(shown: Stage) -> None:
    painted(shown)
    before = pixels(shown, "left image")
    shown.root.get_by_label("Image pair").select_option("pair1")
    assert_holds(shown, lambda held: held.pair, "pair1")
    assert_becomes(shown.page, lambda: pixels(shown, "left image") != before, True)


def test_recipes_are_loaded_and_networks_saved(
    shown: Stage, evaluator: sfkit.Evaluator, tmp_path: Path
) -> None:
    shown.root.get_by_text("Recipe and network").click()
    text = shown.root.get_by_role("textbox", name="Recipe as JSON")
    pool = evaluator.pool
    uniform = pool.bound(pool.uniform()).document()
    assert_becomes(shown.page, lambda: json.loads(text.input_value() or "null"), uniform)
    text.fill(evaluator.pool.equal("c").to_json())
    shown.root.get_by_role("button", name="Load this text").click()
    assert_weights(shown, [["0.00", "0.00", "1.00"]] * 4)
    target = tmp_path / "merged.safetensors"
    shown.root.get_by_role("textbox", name="File for the merged network").fill(str(target))
    shown.root.get_by_role("button", name="Save network").click()
    shown.root.get_by_text(f"saved as {target}").wait_for()
    assert sfkit.read_recipe(target) == inspector(shown).recipe
    text.fill("{}")
    shown.root.get_by_role("button", name="Load this text").click()
    shown.root.get_by_role("alert").filter(has_text="found format None").wait_for()
    shown.root.get_by_role("button", name="Copy").click()
    # What is copied is the recipe.
    assert_becomes(shown.page, text.input_value, inspector(shown).recipe_json)


def test_an_error_comes_into_view(shown: Stage) -> None:
    shown.page.set_viewport_size({"width": 600, "height": 400})
    shown.root.get_by_text("Recipe and network").click()
    shown.root.get_by_role("textbox", name="Recipe as JSON").fill("[]")
    load = shown.root.get_by_role("button", name="Load this text")
    load.click()
    alert = shown.root.get_by_role("alert")
    said = "the pasted text: found a JSON list, expected the object that Recipe.to_json writes"
    assert_becomes(shown.page, alert.inner_text, said)
    top = "(alert) => alert.getBoundingClientRect().top"
    assert_becomes(shown.page, lambda: 0 <= alert.evaluate(top) <= 400, True)


def test_tying_blocks(shown: Stage) -> None:
    shown.page.locator(cell(shown, "neck", "a")).focus()
    shown.page.keyboard.type("1\n")
    shown.root.get_by_role("checkbox", name="tie blocks").check()
    assert_weights(shown, [["0.50", "0.25", "0.25"]] * 4)


@pytest.mark.parametrize("dark", [False, True])
def test_a_saved_notebook_shows_the_last_state(stage: Open, evaluator: sfkit.Evaluator, dark: bool) -> None:
    widget = RoutingInspector(evaluator, tied=False)
    widget.weigh("neck", "a", 0.9)
    widget.pin("A")
    shown = stage(dark=dark)
    shown.show_state(widget)
    assert_weights(shown, [["0.90", "0.05", "0.05"]], slice(1, 2))
    images = shown.root.locator("figure img")
    widths = "all => all.map((image) => image.naturalWidth)"
    assert_becomes(shown.page, lambda: images.evaluate_all(widths), [96, 96, 96, 96])
    shown.page.wait_for_selector(f".sfkit[data-theme='{'dark' if dark else 'light'}']")


@pytest.mark.parametrize("dark", [False, True])
def test_nothing_stands_in_anyone_s_way(
    stage: Open, evaluator: sfkit.Evaluator, search: sfkit.RoutingSearch, dark: bool
) -> None:
    widget = RoutingInspector(evaluator, search=search, tested_on=[evaluator.benchmark])
    for name in "AB":
        widget.pin(name)
    widget.lock("neck", "a", locked=True)
    widget.remove("b")
    shown = stage(dark=dark)
    shown.show_state(widget, error="weight of 'a': is locked, unlock it first")
    shown.root.get_by_text("Recipe and network").click()
    assert shown.findings() == []


def test_names_are_text_and_never_markup(stage: Open, evaluator: sfkit.Evaluator) -> None:
    shown = stage()
    name = "<img src=x onerror=alert(1)>"
    shown.show_state(RoutingInspector(evaluator), sources=[name, "b", "c"], pairs=[name, "pair1"], flag=name)
    assert_becomes(shown.page, shown.root.get_by_role("columnheader", name=name).count, 1)
    assert shown.root.locator("img[src=x]").count() == 0


@pytest.mark.parametrize("width", [1280, 1000, 900, 800])
def test_names_of_sources_are_whole_words_in_columns_that_all_show(
    stage: Open, evaluator: sfkit.Evaluator, width: int
) -> None:
    shown = stage(width=width)
    names = ["photographic-noise", "uneven-exposure", "haze"]
    shown.show_state(RoutingInspector(evaluator), sources=names)
    grid = shown.root.locator(".grid-scroll")
    overhang = "(grid) => grid.scrollWidth - grid.clientWidth"
    assert_becomes(shown.page, lambda: grid.evaluate(overhang), 0)
    lines = """names => names.map((name) =>
        Math.round(name.offsetHeight / parseFloat(getComputedStyle(name).lineHeight))
            <= name.textContent.split("-").length)"""
    heads = shown.root.locator(".grid-name")
    assert_becomes(shown.page, lambda: heads.evaluate_all(lines), [True] * len(names))


@pytest.mark.parametrize("width", [1280, 800])
def test_nothing_is_clipped(stage: Open, evaluator: sfkit.Evaluator, width: int) -> None:
    shown = stage(width=width)
    shown.show_state(RoutingInspector(evaluator))
    overflow = """(root) => [root, ...root.querySelectorAll("div, figure, table")]
        .filter((e) => e.scrollWidth > e.clientWidth + 1 && !e.className.includes("unseen")
            && getComputedStyle(e).overflowX !== "visible")
        .map((e) => `${e.className}: ${e.scrollWidth} > ${e.clientWidth}`)"""
    assert_becomes(shown.page, lambda: shown.root.evaluate(overflow), [])
