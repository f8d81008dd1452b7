"""Stills: what a saved notebook shows of each widget, drawn without a browser."""

from __future__ import annotations

import base64
import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import sfkit_widgets
from browser_compare import widget as compare_widget
from IPython.core.interactiveshell import InteractiveShell
from sfkit_widgets import PopulationView, RoutingInspector, RoutingView, SearchControl, watch
from sfkit_widgets import _still as stills
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._sheet import PALE, Sheet
from tiny import write_pairs, write_pool

import sfkit
from sfkit.analysis import previews
from sfkit.errors import InputError
from sfkit.search import (
    BayesianRoutingSearch,
    BayesianRoutingSettings,
    RoutingSearch,
    RoutingSettings,
    SubsetSearch,
    SubsetSettings,
)
from sfkit.search.bayesian_routing import ProposedRouting

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def scorer(tmp_path_factory: pytest.TempPathFactory) -> sfkit.Evaluator:
    folder = tmp_path_factory.mktemp("world")
    pool = sfkit.open_pool(write_pool(folder / "pool"))
    pairs = write_pairs(folder / "pairs")
    return sfkit.Evaluator(pool, sfkit.open_benchmark("pairs", pairs, metric="bad-2.0"))


@pytest.fixture(scope="module")
def which(scorer: sfkit.Evaluator) -> SubsetSearch:
    search = SubsetSearch(
        scorer.pool.names, scorer.pool.blocks, scorer, SubsetSettings(population=4, generations=2)
    )
    search.run()
    return search


@pytest.fixture(scope="module")
def how(scorer: sfkit.Evaluator) -> RoutingSearch:
    settings = RoutingSettings(evaluations=9, population=4, tied=False)
    search = RoutingSearch(scorer.pool.names, scorer.pool.blocks, scorer, settings)
    search.run()
    return search


def drawn(sheet: Sheet) -> tuple[list[str], list[bytes]]:
    """The texts of a sheet, and its pictures; what a parser of XML finds."""
    root = ET.fromstring(sheet.svg())
    texts = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    images = [base64.b64decode(image.attrib["href"].partition(",")[2]) for image in root.iter(f"{SVG}image")]
    height = float(root.attrib["height"])
    for element in [*root.iter(f"{SVG}image"), *root.iter(f"{SVG}text")]:
        assert float(element.attrib["y"]) + float(element.attrib.get("height", 0)) <= height
    return texts, images


def test_the_inspector_s_shows_weights_scales_scores_and_four_pictures(
    scorer: sfkit.Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(previews, "QUICK_SECONDS", math.inf)
    inspector = RoutingInspector(scorer, ("a", "b"), tied=False)
    inspector.weigh("neck", "a", 0.9)
    texts, images = drawn(inspector.sheet())
    assert [texts.count(weight) for weight in ("0.90", "0.10")] == [1, 1]
    assert f"pair pair0: bad-2.0 {inspector.pair_score:.2f} %; pairs: unknown" in texts
    assert images == [
        inspector.left_picture,
        inspector.truth_picture,
        inspector.disparity_picture,
        inspector.error_picture,
    ]


@pytest.mark.parametrize("shown", ["disparity", "error", "better"])
def test_the_comparison_s_shows_each_network(tmp_path: Path, shown: str) -> None:
    compare = compare_widget(tmp_path, shown=shown)
    texts, images = drawn(compare.sheet())
    assert len(images) == 5
    assert all(cv2.imdecode(np.frombuffer(data, np.uint8), 1).shape == (48, 96, 3) for data in images)
    expected = {"disparity": "uniform: bad-2.0", "error": "uniform, error: bad-2.0", "better": "than base"}
    assert any(expected[shown] in text for text in texts)


def test_a_search_s_shows_scores_and_the_best(which: SubsetSearch, how: RoutingSearch) -> None:
    texts, _ = drawn(PopulationView(which).sheet())
    best = which.best
    assert best is not None
    assert f"1. {best.score:.2f} %: {', '.join(best.subset)}" in texts
    assert "bad-2.0 (% of pixels)" in texts
    texts, _ = drawn(RoutingView(how).sheet())
    assert how.best is not None
    assert f"evaluation {how.best.number}: bad-2.0 {how.best.score:.2f} %" in texts
    texts, _ = drawn(SearchControl(which).sheet())
    assert any(text.startswith("finished: Finished") for text in texts)
    assert any(text.startswith(f"Best so far: bad-2.0 {best.score:.2f} %") for text in texts)


def test_a_model_s_show_what_it_expected_with_its_intervals(scorer: sfkit.Evaluator) -> None:
    """Upright lines as long as the intervals are wide, on one scale."""
    pool = scorer.pool
    settings = BayesianRoutingSettings(evaluations=6)
    search = BayesianRoutingSearch(pool.names, pool.blocks, scorer, settings)
    search.run()
    view = RoutingView(search)
    sheet = view.sheet()
    assert any("predicted, with its 95 % interval" in text for text in drawn(sheet)[0])
    lines = [
        [tuple(map(float, point.split(","))) for point in line.attrib["points"].split()]
        for line in ET.fromstring(sheet.svg()).iter(f"{SVG}polyline")
        if line.attrib["stroke"] == PALE
    ]
    told = [c.prediction for c in search.candidates if isinstance(c, ProposedRouting) and c.prediction]
    assert len(lines) == len(told) > 1
    for line in lines:
        assert len({x for x, _ in line}) == 1, "upright"
    widths = np.array([2 * 1.96 * one.sd for one in told])
    pixels = np.array([line[0][1] - line[1][1] for line in lines])
    assert pixels / pixels.max() == pytest.approx(widths / widths.max(), abs=0.01)


def test_a_watch_waits_on_paper_too(tmp_path: Path) -> None:
    texts, _ = drawn(watch(tmp_path).sheet())
    assert any(text.startswith("Waiting for the first record") for text in texts)


def test_one_call_each_inspects_compares_and_watches(
    scorer: sfkit.Evaluator, which: SubsetSearch, how: RoutingSearch
) -> None:
    pool, benchmark = scorer.pool, scorer.benchmark
    assert sfkit_widgets.inspect(scorer).sources == list(pool.names)
    assert sfkit_widgets.inspect(pool, benchmark, subset=("a", "b")).sources == ["a", "b"]
    shown = sfkit_widgets.compare(pool, benchmark=benchmark, shown="error")
    assert [network["name"] for network in shown.scene["networks"]] == ["base", "all sources equally"]
    for search, view in ((which, PopulationView), (how, RoutingView)):
        watched = watch(search)
        control, second = watched.parts
        assert isinstance(control, SearchControl)
        assert control.live.search is search
        assert isinstance(second, view)
        assert {control.still, second.still} == {f"sfkit-still-{watched.model_id}"}
        texts, _ = drawn(watched.sheet())
        assert texts[0] == "Search"
        watched.close()
    with pytest.raises(InputError, match="pool 'tiny', expected pairs to look at"):
        sfkit_widgets.inspect(pool)
    with pytest.raises(InputError, match="brings one already"):
        sfkit_widgets.inspect(scorer, benchmark)


def test_names_never_become_markup() -> None:
    sheet = Sheet("<b>haze</b> & co")
    sheet.text(0, 0, "x" * 100, room=50)
    texts, _ = drawn(sheet)
    assert texts[0] == "<b>haze</b> & co"
    assert texts[1].endswith("…")
    assert "&lt;b&gt;haze" in stills.Still("n", lambda: sheet).markup()


def test_a_widget_is_displayed_with_its_still_which_follows_at_the_end_of_a_cell(
    scorer: sfkit.Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    shell = InteractiveShell()
    sent: list[tuple[Any, Any]] = []
    monkeypatch.setattr(stills, "get_ipython", lambda: shell)
    monkeypatch.setattr(stills, "publish_display_data", lambda data, *_, **more: sent.append((data, more)))
    assert shell.display_formatter is not None
    inspector = RoutingInspector(scorer, ("a", "b"), tied=False)
    shell.display_formatter.format(inspector)
    (view, _), (still, told) = sent
    assert view["application/vnd.jupyter.widget-view+json"]["model_id"] == inspector.model_id
    assert not told["update"]
    assert f'class="sfkit-still {inspector.still}"' in still["text/html"]
    inspector.weigh("neck", "a", 0.9)
    shell.events.trigger("post_run_cell", None)
    renewed, told = sent[-1]
    assert told == {"transient": {"display_id": inspector.still}, "update": True}
    (code,) = re.findall(r"svg\+xml;base64,([^\"]+)", renewed["text/html"])
    assert b">0.90<" in base64.b64decode(code)
    shell.events.trigger("post_run_cell", None)
    assert len(sent) == 3, "nothing changed since"
    inspector.close()
    shell.events.trigger("post_run_cell", None)
    assert len(sent) == 3


def test_every_widget_has_a_sheet_of_its_own() -> None:
    classes = [getattr(sfkit_widgets, name) for name in sfkit_widgets.__all__]
    for made in classes:
        if isinstance(made, type) and issubclass(made, SfkitWidget):
            assert made.sheet is not SfkitWidget.sheet, made
