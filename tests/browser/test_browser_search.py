"""The scripts of the search widgets on a bare page: buttons, marks, descent, charts, keyboard."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from browser_search import SOURCES, routing_search, subset_search
from browser_stage import Stage
from sfkit_widgets import PopulationView, RoutingView, SearchControl
from sfkit_widgets._assets import script

pytestmark = pytest.mark.browser

Open = Callable[..., Stage]


@pytest.fixture
def made() -> Iterator[list[Any]]:
    """Widgets a test makes; closed afterwards."""
    widgets: list[Any] = []
    yield widgets
    for widget in widgets:
        widget.close()


@pytest.fixture
def population(made: list[Any]) -> PopulationView:
    search, _ = subset_search(permits=10)
    search.run()
    made.append(view := PopulationView(search, metric="epe"))
    return view


@pytest.fixture
def routing(made: list[Any]) -> RoutingView:
    search, _ = routing_search(permits=100)
    search.run()
    made.append(view := RoutingView(search, metric="epe"))
    return view


def wait_for_text(stage: Stage, selector: str, text: str) -> None:
    stage.page.wait_for_selector(f"{selector}:has-text('{text}')")


def test_the_control_runs_a_search_by_keyboard_alone(stage: Open, made: list[Any]) -> None:
    search, scorer = subset_search()
    made.append(control := SearchControl(search))
    shown = stage()
    shown.show(control)
    run = shown.root.get_by_role("button", name="Run")
    shown.page.keyboard.press("Tab")
    assert run.evaluate("(element) => element === document.activeElement")
    shown.page.keyboard.press("Enter")
    shown.settled()
    shown.page.wait_for_selector("[data-phase='running']")
    # The pressed button keeps the focus although it can do nothing now.
    assert run.get_attribute("aria-disabled") == "true"
    assert run.evaluate("(element) => element === document.activeElement")
    shown.page.keyboard.press("Enter")
    assert [message["command"] for message in shown.messages()] == ["run"]
    scorer.open()
    shown.page.wait_for_selector("[data-phase='finished']")
    bar = shown.root.get_by_role("progressbar")
    assert bar.get_attribute("aria-valuenow") == bar.get_attribute("aria-valuemax") == "36"
    assert f"candidate {search.best.number}, from" in shown.root.locator(".sfkit-control-best").inner_text()
    live = shown.root.locator("[aria-live]")
    assert live.inner_text() == "Stage 1: which sources? Finished: all 5 generations are done."


def test_a_watched_search_has_no_buttons(stage: Open, made: list[Any]) -> None:
    made.append(control := SearchControl(subset_search()[0]))
    shown = stage(width=800)
    shown.show_state(control, progress={**control.progress, "watched": True})
    assert shown.root.get_by_role("button").count() == 0


def test_an_error_is_an_alert(stage: Open, made: list[Any]) -> None:
    search, scorer = subset_search(permits=10)
    scorer.broken = True
    made.append(control := SearchControl(search))
    shown = stage()
    shown.show(control)
    shown.root.get_by_role("button", name="Run").click()
    wait_for_text(shown, "[role='alert']", "OSError: the disk is full")
    shown.page.wait_for_selector("[data-phase='failed']")


def test_without_a_generation_it_says_what_to_do(stage: Open, made: list[Any]) -> None:
    made += [view := PopulationView(subset_search()[0]), other := RoutingView(routing_search()[0])]
    for widget in (view, other):
        shown = stage()
        shown.show_state(widget)
        assert "Press Run or One step of a SearchControl" in shown.root.inner_text()
        assert shown.root.get_by_role("slider").count() == 0


def test_individuals_are_rows_of_marks_best_first(stage: Open, population: PopulationView) -> None:
    shown = stage()
    shown.show_state(population)
    rows = shown.root.locator("[role='grid'] [role='row']")
    people, numbers = population.evolution["people"], population.evolution["populations"][-1]
    assert rows.count() == len(numbers) == 6
    for row, number in zip(rows.all(), numbers, strict=True):
        held = [mark.get_attribute("title") for mark in row.locator(".sfkit-population-has").all()]
        assert held == [SOURCES[n] for n in people[str(number)]["sources"]]
        assert people[str(number)]["score"] in row.inner_text()


def test_the_slider_goes_through_generations_and_back_to_the_latest(
    stage: Open, population: PopulationView
) -> None:
    shown = stage()
    shown.show_state(population)
    slider = shown.root.get_by_role("slider", name="Generation")
    assert slider.get_attribute("aria-valuetext") == "generation 5"
    slider.press("Home")
    wait_for_text(shown, ".sfkit-population-which", "0 of 5")
    first = population.evolution["populations"][0]
    shown_numbers = [
        int(str(row.get_attribute("data-number")))
        for row in shown.root.locator("[role='grid'] [role='row']").all()
    ]
    assert shown_numbers == first
    # New generations do not take away what one looks at.
    shown.push(evolution={**population.evolution})
    wait_for_text(shown, ".sfkit-population-which", "0 of 5")
    shown.root.get_by_role("button", name="Latest").click()
    wait_for_text(shown, ".sfkit-population-which", "5 of 5, following")
    shown.root.locator(".sfkit-population-scroll [role='row']").nth(2).click()
    wait_for_text(shown, ".sfkit-population-which", "2 of 5")


def test_descent_is_shown_for_who_is_pointed_at_or_moved_to(stage: Open, population: PopulationView) -> None:
    shown = stage()
    shown.show_state(population)
    found = population.evolution
    generation, number = next(
        (g, n)
        for g, group in zip(found["generations"], found["populations"], strict=True)
        for n in group
        if len(set(found["people"][str(n)]["parents"])) == 2
    )
    shown.root.locator(".sfkit-population-scroll [role='row']").nth(generation).click()
    shown.root.locator(f"[data-number='{number}']").first.hover()
    panel = shown.root.get_by_role("region", name="Descent")
    first, second = found["people"][str(number)]["parents"]
    assert f"Crossover of {first} and {second}" in panel.inner_text()
    panel.get_by_role("button", name=str(first), exact=True).click()
    assert shown.root.locator(f"[data-number='{first}'].sfkit-population-chosen").count() >= 1
    rows = shown.root.locator("[role='grid'] [role='row']")
    shown.root.locator("[role='grid'] [tabindex='0']").focus()
    shown.page.keyboard.press("End")
    assert rows.last.evaluate("(row) => row === document.activeElement")
    shown.page.keyboard.press("ArrowUp")
    assert rows.nth(4).evaluate("(row) => row === document.activeElement")
    assert rows.nth(4).get_attribute("data-number") in panel.inner_text()
    assert shown.root.locator("[role='grid'] [tabindex='0']").count() == 1


def test_the_archive_leads_to_where_a_subset_first_was(stage: Open, population: PopulationView) -> None:
    shown = stage()
    shown.show_state(population)
    best = population.evolution["archive"][0]
    shown.root.get_by_role("region", name="Archive").get_by_role("button", name=str(best), exact=True).click()
    born = population.evolution["people"][str(best)]["generation"]
    wait_for_text(shown, ".sfkit-population-which", f"{born} of 5")


def test_a_chart_tells_values_under_the_pointer_and_picks(stage: Open, routing: RoutingView) -> None:
    shown = stage()
    shown.show_state(routing)
    chart = shown.root.locator("figure").filter(has_text="EPE (px)")
    drawing = chart.locator("svg[role='img']")
    assert "at the end best so far" in str(drawing.get_attribute("aria-label"))
    box = drawing.bounding_box()
    assert box is not None
    drawing.hover(position={"x": 48, "y": box["height"] / 2})
    score = f"{routing.trace['score'][0]:.4g}"
    assert f"evaluation 0: candidate {score}" in chart.inner_text()
    drawing.click(position={"x": 48, "y": box["height"] / 2})
    wait_for_text(shown, ".sfkit-routing-which", "0 of 39")
    cells = shown.root.locator(".sfkit-routing-weight")
    assert cells.all_inner_texts() == ["0.33"] * 9
    assert shown.root.locator(".sfkit-routing-scale").all_inner_texts() == ["× 1.00"] * 3
    shown.root.get_by_role("button", name="Best").click()
    best = routing.trace["best"]
    wait_for_text(shown, ".sfkit-routing-which", f"{best} of 39")
    weights = [f"{w:.2f}" for row in routing.trace["weights"][best] for w in row]
    assert cells.all_inner_texts() == weights
    shown.root.get_by_role("slider", name="Evaluation").press("ArrowRight")
    wait_for_text(shown, ".sfkit-routing-which", f"{best + 1} of 39")


@pytest.mark.parametrize("width", [1280, 800, 480])
def test_nothing_is_wider_than_the_page(
    stage: Open, width: int, population: PopulationView, routing: RoutingView
) -> None:
    for widget in (population, routing, SearchControl(subset_search()[0])):
        shown = stage(width=width)
        shown.show_state(widget)
        assert shown.page.evaluate("document.documentElement.scrollWidth") <= width
        shown.page.set_viewport_size({"width": 640, "height": 900})
        shown.page.wait_for_function("() => document.documentElement.scrollWidth <= 640")


def test_names_of_sources_never_become_markup(stage: Open, population: PopulationView) -> None:
    shown = stage()
    name = "<img src=x onerror=alert(1)>"
    shown.show_state(population, evolution={**population.evolution, "sources": [name, *SOURCES[1:]]})
    assert shown.page.locator("img").count() == 0
    assert name in shown.root.inner_text()


FUNCTIONS = """async (source) => {
    const text = source.replace("export default { render };", "");
    const names = ["ticks", "logTicks", "spread", "linePath", "linear", "scale", "numberText",
        "nearestIndex", "made", "offspring", "sourceColumns"];
    const whole = `${text}\\nexport { ${names.join(", ")} };`;
    const url = URL.createObjectURL(new Blob([whole], { type: "text/javascript" }));
    const m = await import(url);
    return {
        ticks: [m.ticks(0, 1), m.ticks(23.7, 26.9, 4), m.ticks(0, 3, 8, true), m.ticks(2, 2)],
        logs: [m.logTicks(0.01, 10, 5), m.logTicks(0.32, 0.62, 4)],
        spread: [m.spread([], false), m.spread([2], false), m.spread([1, 2], true)],
        path: [m.linePath([[0, 1], [2, 3], null, [4, 5]], false), m.linePath([[0, 1], [2, 3]], true)],
        linear: m.linear([0, 10], [100, 200])(5),
        log: m.scale([1, 100], [0, 2], true)(10),
        text: [m.numberText(0.123456), m.numberText(25), m.numberText(1234.56)],
        nearest: [m.nearestIndex([0, 10, 20], 14), m.nearestIndex([], 1)],
        made: [
            m.made({ operators: ["random"], parents: [] }),
            m.made({ operators: ["start"], parents: [] }),
            m.made({ operators: ["copy", "delete"], parents: [3] }),
            m.made({ operators: ["crossover"], parents: [3, 4] }),
        ],
        offspring: m.offspring({ 5: { parents: [1, 2] }, 6: { parents: [3] } }, 1),
    };
}"""


def test_the_pure_functions(stage: Open) -> None:
    page = stage().page
    found = page.evaluate(FUNCTIONS, script("population_view.js"))
    assert found["ticks"] == [[0, 0.2, 0.4, 0.6, 0.8, 1], [24, 25, 26], [0, 1, 2, 3], [2]]
    assert found["logs"] == [[0.01, 0.05, 0.2, 1, 5], [0.4, 0.5, 0.6]]
    assert found["spread"] == [[0, 1], [1.8, 2.2], [0.8, 2.5]]
    assert found["path"] == ["M0 1L2 3M4 5", "M0 1H2V3"]
    assert found["linear"] == 150
    assert found["log"] == pytest.approx(1.0)
    assert found["text"] == ["0.1235", "25", "1235"]
    assert found["nearest"] == [1, -1]
    assert found["made"] == [
        "Drawn at random.",
        "Given to start from.",
        "Copy of 3, then delete.",
        "Crossover of 3 and 4.",
    ]
    assert found["offspring"] == [5]
