"""The scripts of the search widgets on a bare page: buttons, marks, descent, charts, keyboard."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from browser_search import SOURCES, routing_search, searches_by_model, subset_search
from browser_stage import Stage, assert_becomes, still_box
from sfkit_widgets import PopulationView, RoutingView, RunTable, SearchControl

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


FOCUSED = "(element) => element === document.activeElement"


def test_the_control_runs_a_search_by_keyboard_alone(stage: Open, made: list[Any]) -> None:
    search, scorer = subset_search()
    made.append(control := SearchControl(search))
    shown = stage()
    shown.show(control)
    run = shown.root.get_by_role("button", name="Run")
    shown.page.keyboard.press("Tab")
    assert_becomes(shown.page, lambda: run.evaluate(FOCUSED), True)
    shown.page.keyboard.press("Enter")
    shown.page.wait_for_selector("[data-phase='running']")
    # The pressed button keeps the focus although it can do nothing now.
    assert_becomes(shown.page, lambda: run.get_attribute("aria-disabled"), "true")
    assert_becomes(shown.page, lambda: run.evaluate(FOCUSED), True)
    shown.page.keyboard.press("Enter")
    scorer.open()
    shown.page.wait_for_selector("[data-phase='finished']")
    bar = shown.root.get_by_role("progressbar")
    assert_becomes(shown.page, lambda: bar.get_attribute("aria-valuenow"), "36")
    assert_becomes(shown.page, lambda: bar.get_attribute("aria-valuemax"), "36")
    assert [message["command"] for message in shown.messages()] == ["run"]
    assert search.best is not None
    wait_for_text(shown, ".sfkit-control-best", f"candidate {search.best.number}, from")
    live = shown.root.locator("[aria-live]")
    said = "Stage 1: which sources? Finished: all 5 generations are done."
    assert_becomes(shown.page, live.inner_text, said)


def test_a_watched_search_has_no_buttons(stage: Open, made: list[Any]) -> None:
    made.append(control := SearchControl(subset_search()[0]))
    shown = stage(width=800)
    shown.show_state(control, progress={**control.progress, "watched": True})
    assert_becomes(shown.page, shown.root.get_by_role("button").count, 0)


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
        wait_for_text(shown, ".sfkit", "Press Run or One step of a SearchControl")
        assert_becomes(shown.page, shown.root.get_by_role("slider").count, 0)


def test_individuals_are_rows_of_marks_best_first(stage: Open, population: PopulationView) -> None:
    shown = stage()
    shown.show_state(population)
    rows = shown.root.locator("[role='grid'] [role='row']")
    people, numbers = population.evolution["people"], population.evolution["populations"][-1]
    assert len(numbers) == 6
    assert_becomes(shown.page, rows.count, 6)
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
    assert_becomes(shown.page, lambda: slider.get_attribute("aria-valuetext"), "generation 5")
    slider.press("Home")
    wait_for_text(shown, ".sfkit-population-which", "0 of 5")
    first = population.evolution["populations"][0]
    rows = shown.root.locator("[role='grid'] [role='row']")
    numbers = "rows => rows.map((row) => Number(row.dataset.number))"
    assert_becomes(shown.page, lambda: rows.evaluate_all(numbers), first)
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
    panel.get_by_text(f"Crossover of {first} and {second}").wait_for()
    panel.get_by_role("button", name=str(first), exact=True).click()
    shown.root.locator(f"[data-number='{first}'].sfkit-population-chosen").first.wait_for()
    rows = shown.root.locator("[role='grid'] [role='row']")
    shown.root.locator("[role='grid'] [tabindex='0']").focus()
    shown.page.keyboard.press("End")
    assert_becomes(shown.page, lambda: rows.last.evaluate(FOCUSED), True)
    shown.page.keyboard.press("ArrowUp")
    assert_becomes(shown.page, lambda: rows.nth(4).evaluate(FOCUSED), True)
    panel.get_by_text(str(rows.nth(4).get_attribute("data-number"))).first.wait_for()
    assert_becomes(shown.page, shown.root.locator("[role='grid'] [tabindex='0']").count, 1)


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
    told = "(drawing) => drawing.getAttribute('aria-label').includes('at the end best so far')"
    assert_becomes(shown.page, lambda: drawing.evaluate(told), True)
    *_, height = still_box(drawing)
    drawing.hover(position={"x": 48, "y": height / 2})
    score = f"{routing.trace['score'][0]:.4g}"
    chart.get_by_text(f"evaluation 0: candidate {score}").wait_for()
    drawing.click(position={"x": 48, "y": height / 2})
    wait_for_text(shown, ".sfkit-routing-which", "0 of 39")
    cells = shown.root.locator(".sfkit-routing-weight")
    assert_becomes(shown.page, cells.all_inner_texts, ["0.33"] * 9)
    scales = shown.root.locator("td.sfkit-routing-scale")
    assert_becomes(shown.page, scales.all_inner_texts, ["× 1.00"] * 3)
    shown.root.get_by_role("button", name="Best").click()
    best = routing.trace["best"]
    wait_for_text(shown, ".sfkit-routing-which", f"{best} of 39")
    weights = [f"{w:.2f}" for row in routing.trace["weights"][best] for w in row]
    assert_becomes(shown.page, cells.all_inner_texts, weights)
    shown.root.get_by_role("slider", name="Evaluation").press("ArrowRight")
    wait_for_text(shown, ".sfkit-routing-which", f"{best + 1} of 39")


@pytest.mark.parametrize("width", [1280, 800, 480])
def test_nothing_is_wider_than_the_page(
    stage: Open, width: int, population: PopulationView, routing: RoutingView
) -> None:
    for widget in (population, routing, SearchControl(subset_search()[0])):
        shown = stage(width=width)
        shown.show_state(widget)
        shown.page.wait_for_function(f"() => document.documentElement.scrollWidth <= {width}")
        shown.page.set_viewport_size({"width": 640, "height": 900})
        shown.page.wait_for_function("() => document.documentElement.scrollWidth <= 640")


def test_names_are_never_broken_within_a_word(stage: Open, routing: RoutingView) -> None:
    names = ["photographic-noise", "uneven-exposure", "haze"]
    for width, upright in ((1280, False), (900, True)):
        shown = stage(width=width)
        shown.show_state(routing, trace={**routing.trace, "sources": names})
        head = shown.root.locator("th > span")
        assert_becomes(shown.page, head.all_inner_texts, names)
        assert_becomes(shown.page, shown.root.locator(".sfkit-routing-upright").count, int(upright))
        whole = """names => names.map((name) => name.scrollHeight <= name.offsetHeight + 1
            && name.getBoundingClientRect().width <= name.closest('th').clientWidth)"""
        assert_becomes(shown.page, partial(head.evaluate_all, whole), [True] * len(names))


@pytest.mark.parametrize("width", [1280, 900, 480])
def test_a_wide_heatmap_shows_or_scrolls_all_its_numbers(
    stage: Open, width: int, routing: RoutingView
) -> None:
    wide = routing.trace["weights"]
    weights = [[row * 3 for row in rows] for rows in wide]
    colours = routing.trace["colours"] * 3
    shown = stage(width=width)
    names = [f"source-{n}" for n in range(9)]
    shown.show_state(
        routing, trace={**routing.trace, "sources": names, "weights": weights, "colours": colours}
    )
    cells = shown.root.locator(".sfkit-routing-heat :is(td, .sfkit-routing-scale)")
    whole = "cells => cells.map((cell) => cell.scrollWidth <= cell.clientWidth)"
    assert_becomes(shown.page, lambda: cells.evaluate_all(whole), [True] * (3 * 10 + 1))
    heat = shown.root.locator(".sfkit-routing-heat")
    scrolls = "(heat) => [heat.scrollWidth > heat.clientWidth, heat.getAttribute('tabindex') === '0']"
    assert_becomes(shown.page, lambda: heat.evaluate(scrolls), [width == 480] * 2)
    assert shown.findings() == []


def test_names_of_sources_never_become_markup(stage: Open, population: PopulationView) -> None:
    shown = stage()
    name = "<img src=x onerror=alert(1)>"
    shown.show_state(population, evolution={**population.evolution, "sources": [name, *SOURCES[1:]]})
    shown.root.get_by_text(name).first.wait_for()
    assert shown.page.locator("img").count() == 0


@pytest.mark.parametrize("dark", [False, True])
def test_axe_finds_nothing_serious(
    stage: Open,
    made: list[Any],
    population: PopulationView,
    routing: RoutingView,
    dark: bool,
    tmp_path: Path,
) -> None:
    made.append(control := SearchControl(subset_search()[0]))
    progress = {**control.progress, "phase": "failed", "allowed": ["run", "step"]}
    best = {"score": "EPE 3.20 px", "candidate": 3, "sources": list(SOURCES)}
    which, how = searches_by_model(tmp_path / "journal.jsonl")
    made += [by_model := PopulationView(which, metric="epe"), routed := RoutingView(how, metric="epe")]
    for widget, state in (
        (control, {"progress": progress, "error": "OSError: the disk is full"}),
        (control, {"progress": {**progress, "phase": "running", "best": best, "allowed": ["pause"]}}),
        (population, {}),
        (routing, {}),
        (by_model, {}),
        (routed, {}),
        (RunTable(tmp_path), {}),
    ):
        shown = stage(width=800, dark=dark)
        shown.show_state(widget, **state)
        expects = shown.root.locator(".sfkit-model:not([hidden])")
        figures = 3 if widget in (by_model, routed) else 0
        assert_becomes(shown.page, expects.locator("figure").count, figures)
        if widget in (population, by_model):
            shown.root.locator("[role=grid] [role=row]").nth(2).hover()
            shown.root.locator("[role=grid] .sfkit-population-chosen").first.wait_for()
            origin = shown.root.get_by_role("heading", name="Where does it come from?")
            assert_becomes(shown.page, origin.count, int(widget is by_model))
        if isinstance(widget, RunTable):
            shown.root.get_by_role("button", name="scored").click()
            sorted_by = shown.root.locator("th[aria-sort=ascending]")
            assert_becomes(shown.page, sorted_by.all_inner_texts, ["scored"])
            shown.root.locator("tbody tr").filter(has_text="Stage 2").click()
            assert_becomes(shown.page, shown.root.locator(".sfkit-runs-figure polyline").count, 10)
        assert shown.findings() == [], type(widget).__name__
