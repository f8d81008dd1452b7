"""DisparityCompare on a bare page: its colours are the figures', and mouse and keyboard do what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_compare import HEIGHT, HOLE, WIDTH, panels, widget
from browser_stage import Stage, assert_becomes, still_box
from numpy.typing import NDArray
from sfkit_widgets._compare_scene import scene
from sfkit_widgets.disparity_compare import DisparityCompare

from sfkit.analysis.differences import advantage
from sfkit.colours import DISPARITY, ERROR, ERROR_SPAN, error_position, hatch, paint
from sfkit.figures.differences import ADVANTAGE_SPAN

pytestmark = pytest.mark.browser

Open = Callable[..., Stage]
KEPT = ".sfkit[data-kept='true']"
# The colours of a panel at the centres of the image's pixels; it shows the whole image.
COLOURS = f"""(canvas) => {{
    const context = canvas.getContext("2d");
    const {{ data }} = context.getImageData(0, 0, canvas.width, canvas.height);
    const found = [];
    for (let y = 0; y < {HEIGHT}; y += 1) {{
        for (let x = 0; x < {WIDTH}; x += 1) {{
            const column = Math.floor((x + 0.5) * canvas.width / {WIDTH});
            const row = Math.floor((y + 0.5) * canvas.height / {HEIGHT});
            const at = 4 * (row * canvas.width + column);
            found.push(data[at], data[at + 1], data[at + 2]);
        }}
    }}
    return found;
}}"""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> DisparityCompare:
    """For its state alone; the scene of the hand-made pair takes the place of its own."""
    return widget(tmp_path_factory.mktemp("compare"))


@pytest.fixture
def shown(stage: Open, tiny: DisparityCompare) -> Callable[..., Stage]:
    """The hand-made pair, without a kernel: ``shown(width=800, shown="error")``."""

    def show(width: int = 1280, *, dark: bool = False, **state: object) -> Stage:
        opened = stage(width=width, dark=dark)
        held = {"scene": scene(panels()), "first": "shift", "second": "lumpy", "pairs": ["ramp", "other"]}
        opened.show_state(tiny, **{**held, **state})
        drawn(opened)
        return opened

    return show


def drawn(opened: Stage) -> None:
    """Wait until the next frame after this one is drawn: of what the page already knows, and no more."""
    opened.page.wait_for_function(
        "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
    )


def colours(opened: Stage, key: str) -> NDArray[np.uint8]:
    found = opened.page.locator(f"canvas[data-panel='{key}']").evaluate(COLOURS)
    return np.array(found, np.uint8).reshape(HEIGHT, WIDTH, 3)


def assert_colours(
    opened: Stage, key: str, expected: NDArray[np.uint8], where: tuple[slice, ...] = (), within: int = 5
) -> None:
    """A panel becomes the expected colours, but for a neighbouring entry of the colour table.

    Quantising may cross between two entries, which differ by ``within`` at most.
    """

    def off() -> int:
        return int(np.abs(colours(opened, key)[where].astype(int) - expected[where]).max())

    assert_becomes(opened.page, lambda: max(off(), within), within)


def drag(opened: Stage, key: str, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Between two places of a panel, in shares of its size."""
    left, top, width, height = still_box(opened.page.locator(f"canvas[data-panel='{key}']"))
    places = [(left + x * width, top + y * height) for x, y in (start, end)]
    mouse = opened.page.mouse
    mouse.move(*places[0])
    mouse.down()
    mouse.move(*places[1], steps=4)
    mouse.up()


def values(opened: Stage) -> dict[str, list[str]]:
    """The table of values: row -> cells."""
    rows = opened.root.locator("tbody tr").all()
    return {row.locator("th").inner_text(): row.locator("td").all_inner_texts() for row in rows}


def assert_told(opened: Stage, **expected: object) -> None:
    """Assert that the looks that the widget tells Python come to be ``expected``."""
    told: dict[str, Any] = {}

    def known() -> dict[str, object]:
        for message in opened.messages():
            told.update(message["arguments"])
        return {name: told.get(name) for name in expected}

    assert_becomes(opened.page, known, expected)


def text_of(opened: Stage, selector: str) -> Callable[[], str]:
    return lambda: opened.root.locator(selector).inner_text()


def test_disparities_have_the_figures_colours(shown: Callable[..., Stage]) -> None:
    opened = shown()
    assert_colours(opened, "truth", paint(panels().truth, (2.0, 20.0), DISPARITY))
    for number, network in enumerate(panels().networks):
        seen = np.where(np.isfinite(network.disparity), network.disparity, np.nan)
        assert_colours(opened, f"network {number}", paint(seen, (2.0, 20.0), DISPARITY))


def test_no_truth_is_hatched_and_not_zero(shown: Callable[..., Stage]) -> None:
    opened = shown(limits=[0.0, 20.0])
    assert_colours(opened, "truth", hatch(HEIGHT, WIDTH), np.s_[:, :HOLE], within=0)


def test_errors_have_the_figures_colours(shown: Callable[..., Stage]) -> None:
    opened = shown(shown="error")
    for number, network in enumerate(panels().networks):
        position = np.where(np.isnan(network.error), np.nan, error_position(network.error, 1.0))
        expected = paint(position, (-ERROR_SPAN, ERROR_SPAN), ERROR)
        assert_colours(opened, f"network {number}", expected)


def test_a_frame_without_a_size_leaves_no_panel_empty(shown: Callable[..., Stage]) -> None:
    opened = shown()
    # JupyterLab hides everything for a moment while it changes its theme; no observer notices.
    opened.page.evaluate(
        """() => {
            const { style } = document.querySelector(".sfkit");
            requestAnimationFrame(() => (style.display = "none"));
            window.model.push({ shown: "error" });
            requestAnimationFrame(() => (style.display = ""));
        }"""
    )
    position = error_position(panels().networks[0].error, 1.0)
    assert_colours(opened, "network 0", paint(position, (-ERROR_SPAN, ERROR_SPAN), ERROR))


def test_better_is_blue_and_worse_orange_against_a(shown: Callable[..., Stage]) -> None:
    opened = shown(shown="better")
    reference, *others = panels().networks
    for number, network in enumerate(others, start=1):
        found = advantage(reference.error, network.error, 1.0)
        expected = paint(found.difference, (-ADVANTAGE_SPAN, ADVANTAGE_SPAN), ERROR)
        assert_colours(opened, f"network {number}", expected)
    said = "lumpy: better where\nagainst shift: 0.0 % fixed, 10.0 % broken"
    assert_becomes(opened.page, text_of(opened, "figure[data-panel='network 1'] figcaption"), said)
    opened.page.wait_for_selector("figure[data-panel='network 0']:has-text('shift: error')")


def test_all_panels_zoom_at_the_mouse(shown: Callable[..., Stage]) -> None:
    opened = shown(shown="error")
    panel = opened.page.locator("canvas[data-panel='network 1']")
    *_, width, height = still_box(panel)
    # Over the lump, at column 36.5 and row 10.5 of the image.
    place = {"x": width * 36.5 / WIDTH, "y": height * 10.5 / HEIGHT}
    panel.click(position=place)
    for _ in range(13):
        opened.page.mouse.wheel(0, -120)
    zoom = 1.2**13
    centre = {
        "x": 36.5 - (36.5 / WIDTH - 0.5) * WIDTH / zoom,
        "y": 10.5 - (10.5 / HEIGHT - 0.5) * HEIGHT / zoom,
    }
    assert_told(opened, camera=pytest.approx({**centre, "zoom": zoom}, abs=0.2))

    def seen() -> list[bool]:
        even, lump = (colours(opened, f"network {number}")[:5] for number in (0, 1))
        one = len(np.unique(even.reshape(-1, 3), axis=0)) == 1
        return [one, bool((even[..., 2] > even[..., 0]).all()), bool((lump[..., 0] > lump[..., 2]).all())]

    # Every panel now shows the inside of the lump alone; the cursor is in the middle rows.
    assert_becomes(opened.page, seen, [True, True, True])


def test_the_wheel_scrolls_the_notebook_until_a_panel_is_clicked(shown: Callable[..., Stage]) -> None:
    opened = shown()
    opened.page.locator("canvas[data-panel='truth']").hover()
    opened.page.evaluate("addEventListener('wheel', () => (window.turned = true))")
    opened.page.mouse.wheel(0, -120)
    opened.page.wait_for_function("() => window.turned")
    drawn(opened)
    assert opened.root.locator("output").inner_text() == "100 %"


def test_dragging_pans_within_the_image(shown: Callable[..., Stage]) -> None:
    opened = shown(camera={"x": 24, "y": 12, "zoom": 4})
    drag(opened, "truth", (0.5, 0.5), (0.75, 0.5))
    assert_told(opened, camera=pytest.approx({"x": 24 - WIDTH / 4 / 4, "y": 12, "zoom": 4}, abs=0.1))
    drag(opened, "left", (0.1, 0.5), (0.9, 0.5))
    drag(opened, "left", (0.1, 0.5), (0.9, 0.5))
    # Beyond the edge; what shows stays inside.
    assert_told(opened, camera=pytest.approx({"x": 12 - 1.6 * WIDTH / 4 + 9, "y": 12, "zoom": 4}, abs=0.2))

    def same() -> bool:
        edge = colours(opened, "truth")
        return np.array_equal(edge[:, 0], edge[:, 1])

    assert_becomes(opened.page, same, True)


def test_values_under_the_mouse(shown: Callable[..., Stage]) -> None:
    opened = shown()
    panel = opened.page.locator("canvas[data-panel='left']")
    *_, width, height = still_box(panel)
    panel.hover(position={"x": width * 35.5 / WIDTH, "y": height * 10.5 / HEIGHT})
    truth = panels().truth[10, 35]
    assert_becomes(opened.page, text_of(opened, "caption"), "Values at the cursor: x 35, y 10")
    expected = {
        "ground truth": [f"{truth:.2f}", "", ""],
        "shift": [f"{truth + 0.5:.2f}", "0.50", "0.00"],
        "lumpy": [f"{truth + 7:.2f}", "7.00", "+6.50"],
        "<i>broken</i>": [f"{truth:.2f}", "0.00", "−0.50"],
    }
    assert_becomes(opened.page, lambda: values(opened), expected)


def test_values_where_there_are_none(shown: Callable[..., Stage]) -> None:
    opened = shown(cursor=[3, 0])
    assert_becomes(opened.page, lambda: values(opened)["ground truth"][0], "none")
    assert_becomes(opened.page, lambda: values(opened)["shift"], ["3.50", "none", "0.00"])
    corner = shown(cursor=[WIDTH - 1, 0])
    assert_becomes(corner.page, lambda: values(corner)["<i>broken</i>"], ["not finite"] * 3)


def test_everything_by_keyboard(shown: Callable[..., Stage]) -> None:
    opened = shown(cursor=[20, 10])
    press = opened.page.keyboard.press
    opened.root.get_by_role("application").focus()
    for key in ("ArrowRight", "Shift+ArrowRight", "ArrowUp", "2", "+", "+"):
        press(key)
    said = f"x 31, y 9: ground truth {panels().truth[9, 31]:.2f} px; shift "
    assert_becomes(opened.page, lambda: text_of(opened, "[aria-live]")().startswith(said), True)
    assert_becomes(opened.page, text_of(opened, "output"), "144 %")
    # The point under the cursor stays where it is.
    camera = {"x": 31.5 + (WIDTH / 2 - 31.5) / 1.44, "y": 9.5 + (HEIGHT / 2 - 9.5) / 1.44, "zoom": 1.44}
    assert_told(opened, cursor=[31, 9], shown="error", camera=pytest.approx(camera))
    press("n")
    assert_becomes(opened.page, text_of(opened, "caption"), "Values at the cursor: x 35, y 10")
    press("0")
    assert_becomes(opened.page, text_of(opened, "output"), "100 %")


def test_the_view_follows_the_cursor(shown: Callable[..., Stage]) -> None:
    opened = shown(cursor=[24, 12], camera={"x": 24, "y": 12, "zoom": 6})
    opened.root.get_by_role("application").focus()
    opened.page.keyboard.press("Shift+ArrowRight")
    assert_told(opened, cursor=[34, 12], camera={"x": 34 + 1 - WIDTH / 6 / 2, "y": 12, "zoom": 6})


def test_a_region_is_jumped_to_and_marked(shown: Callable[..., Stage]) -> None:
    opened = shown()
    button = opened.root.locator("ol button")
    mean = (95 * 5 + 7) / 96
    said = [f"96 px beyond 1 px: mean {mean:.2f}, worst 7.00"]
    assert_becomes(opened.page, button.all_inner_texts, said)
    button.click()
    # 48 / 12 and 24 / 8 leave room for a zoom of 3 / 2.5; the centre as near (36, 10) as the edges let it.
    assert_told(opened, cursor=[35, 10], camera=pytest.approx({"x": 28, "y": 10, "zoom": 1.2}))
    assert_becomes(opened.page, lambda: button.get_attribute("aria-pressed"), "true")
    opened.root.get_by_label("Outlier regions of B").select_option("shift")
    opened.root.get_by_text("No region of 8 or more bad pixels.").wait_for()


def test_a_swipe_shows_a_at_the_left_and_b_at_the_right(shown: Callable[..., Stage]) -> None:
    opened = shown(arrangement="swipe", shown="error", divider=0.75)
    drag(opened, "stage", (0.75, 0.9), (0.8, 0.9))
    assert_told(opened, divider=pytest.approx(0.8, abs=0.01))
    expected = [
        paint(np.where(np.isnan(n.error), np.nan, error_position(n.error, 1.0)), (-3, 3), ERROR)
        for n in panels().networks[:2]
    ]
    cut = round(0.8 * WIDTH)
    # Off the cursor and the divider.
    assert_colours(opened, "stage", expected[0], np.s_[:5, : cut - 1])
    assert_colours(opened, "stage", expected[1], np.s_[:5, cut + 2 :])
    opened.root.get_by_label("divider").fill("0.1")
    assert_colours(opened, "stage", expected[1], np.s_[:5, 10:], within=0)


def test_blinking_by_hand(shown: Callable[..., Stage]) -> None:
    opened = shown(arrangement="blink")
    title = opened.root.locator("figure[data-panel='stage'] strong")
    opened.page.wait_for_function(
        "() => document.querySelector('[data-panel=stage] strong').textContent === 'B lumpy: disparity'"
    )
    pause = opened.root.get_by_role("button", name="blink by itself")
    pause.click()
    assert_becomes(opened.page, lambda: pause.get_attribute("aria-pressed"), "false")
    other = {"A shift: disparity": "B lumpy: disparity", "B lumpy: disparity": "A shift: disparity"}
    before = title.inner_text()
    opened.root.get_by_role("application").focus()
    opened.page.keyboard.press("Space")
    assert_becomes(opened.page, title.inner_text, other[before])


def test_who_wants_less_motion_is_not_blinked_at(stage: Open, tiny: DisparityCompare) -> None:
    opened = stage()
    opened.page.emulate_media(reduced_motion="reduce")
    opened.show_state(tiny, arrangement="blink")
    drawn(opened)
    button = opened.root.get_by_role("button", name="blink by itself")
    assert_becomes(opened.page, lambda: button.get_attribute("aria-pressed"), "false")


def test_the_colour_range_is_shared_and_labelled(shown: Callable[..., Stage]) -> None:
    opened = shown()
    opened.root.get_by_label("highest disparity of the colours, px").fill("11")
    opened.page.keyboard.press("Enter")
    assert_told(opened, limits=[2, 11])
    assert_colours(opened, "truth", paint(panels().truth, (2.0, 11.0), DISPARITY))
    bar = opened.root.get_by_role("img", name="disparity (px): ≤ 2, 4.25, 6.5, 8.75, ≥ 11")
    assert_becomes(opened.page, bar.count, 1)
    lowest = opened.root.get_by_label("lowest disparity of the colours, px")
    lowest.fill("30")
    opened.page.keyboard.press("Enter")
    assert_becomes(opened.page, lowest.input_value, "2")


def test_another_pair_is_asked_of_python(stage: Open, tmp_path: Path) -> None:
    opened, compare = stage(), widget(tmp_path)
    opened.show(compare)
    opened.root.get_by_role("combobox", name="pair").select_option("pair1")
    opened.page.wait_for_selector(".sfkit[data-pair='pair1']")
    opened.settled()
    assert_becomes(opened.page, lambda: compare.scene["pair"], "pair1")
    opened.root.get_by_role("button", name="error", exact=True).click()
    assert_becomes(opened.page, lambda: compare.shown, "error")
    opened.page.wait_for_selector(KEPT)
    compare.shown = "better"
    opened.page.wait_for_selector("button[data-value='better'][aria-pressed='true']")


def test_a_pair_that_fails_leaves_the_last_one(stage: Open, tmp_path: Path) -> None:
    opened, compare = stage(), widget(tmp_path)
    opened.show(compare)
    (tmp_path / "pairs/pair1/left.png").unlink()
    opened.root.get_by_role("button", name="next pair").click()
    opened.root.get_by_role("alert").filter(has_text="left.png").wait_for()
    assert_becomes(opened.page, opened.root.get_by_role("combobox", name="pair").input_value, "pair0")


def test_a_saved_state_shows_and_can_be_explored_without_a_kernel(shown: Callable[..., Stage]) -> None:
    opened = shown(camera={"x": 36, "y": 10, "zoom": 4}, cursor=[35, 10], shown="error")
    assert_becomes(opened.page, text_of(opened, "output"), "400 %")
    assert_becomes(opened.page, lambda: values(opened)["lumpy"][1], "7.00")
    opened.root.get_by_role("button", name="zoom in").click()
    assert_becomes(opened.page, text_of(opened, "output"), "480 %")
    assert {message["command"] for message in opened.messages()} <= {"look"}
    assert opened.root.locator(".sfkit-waiting").is_hidden()


@pytest.mark.parametrize("width", [1280, 800, 420])
def test_nothing_is_wider_than_its_place(shown: Callable[..., Stage], width: int) -> None:
    opened = shown(width=width, dark=width == 800, shown="better")
    fits = (
        f"(root) => document.documentElement.scrollWidth <= {width} && root.scrollWidth <= root.clientWidth"
    )
    assert_becomes(opened.page, lambda: opened.root.evaluate(fits), True)


def test_names_are_text(shown: Callable[..., Stage]) -> None:
    opened = shown()
    assert opened.root.locator("i:text('broken')").count() == 0


def test_nothing_runs_on_when_it_is_closed(shown: Callable[..., Stage]) -> None:
    opened = shown(arrangement="blink")
    opened.page.evaluate("window.close()")
    assert opened.page.evaluate("window.model.listening") == 0
    opened.page.evaluate("window.seen = document.querySelector('[data-panel=stage] strong').textContent")
    opened.root.get_by_role("button", name="swipe").click()
    drawn(opened)
    assert opened.root.locator("figure[data-panel='stage'] strong").inner_text() == opened.page.evaluate(
        "window.seen"
    )


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("arrangement", ["side by side", "swipe", "blink"])
def test_axe_finds_nothing_serious(shown: Callable[..., Stage], arrangement: str, dark: bool) -> None:
    opened = shown(dark=dark, arrangement=arrangement, shown="better", cursor=[35, 10])
    assert opened.findings() == []
