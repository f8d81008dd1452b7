"""What every figure must show: a question, axes with units, finite marks, both themes, few points."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from figure_records import FIGURES, trace

from sfkit import figures
from sfkit.analysis.drawn_points import LIMIT
from sfkit.errors import InputError

WITHOUT_UNIT = {"source", "network", "method", "stage", "block", "run", "target"}
WITHOUT_UNIT |= {"granularity of the weights", "selection of sources"}
THEMES = ["light", "dark", "auto"]


def axis_titles(figure: go.Figure) -> list[str]:
    axes = [*figure.select_xaxes(), *figure.select_yaxes()]
    return [axis.title.text for axis in axes if axis.title.text]


def coordinates(figure: go.Figure) -> Iterator[float]:
    """Every number a mark stands at."""
    for drawn in figure.data:
        for name in ("x", "y"):
            values = getattr(drawn, name)
            for value in [] if values is None else values:
                if isinstance(value, int | float | np.number):
                    yield float(value)


def test_a_figure_and_its_numbers_share_a_name() -> None:
    homes = {getattr(figures, name).__module__ for name in figures.__all__ if name.endswith("_figure")}
    subjects = {home.rpartition(".")[2] for home in homes} - {"distributions"}  # another view of routings
    rooms = ("analysis", "baselines")
    numbers = {n for n in subjects for room in rooms if importlib.util.find_spec(f"sfkit.{room}.{n}")}
    assert subjects - numbers == set()


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("theme", THEMES)
def test_every_figure_draws_in_every_theme_and_is_valid_json(name: str, theme: str) -> None:
    figure = FIGURES[name](theme)
    assert figure.layout.template.layout.font.color == figures.template(theme).layout.font.color
    card = "rgba(255,255,255,0.93)"  # no one ink reads on both pages: it brings its own paper
    assert figure.layout.template.layout.paper_bgcolor == (card if theme == "auto" else "rgba(0,0,0,0)")
    assert figure.layout.height > 200
    assert json.loads(figure.to_json())["data"]


@pytest.mark.parametrize("name", FIGURES)
def test_titles_ask_and_axes_have_units(name: str) -> None:
    figure = FIGURES[name]("auto")
    assert figure.layout.title.text.endswith("?")
    assert figure.layout.title.subtitle.text
    titles = axis_titles(figure)
    for title in titles:
        assert title in WITHOUT_UNIT or "(" in title, title
    if name not in ("disparity", "advantage"):
        assert len(titles) >= 2


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_drawn_at_a_value_that_is_not_finite(name: str) -> None:
    assert all(math.isfinite(value) for value in coordinates(FIGURES[name]("auto")))


@pytest.mark.parametrize("name", FIGURES)
def test_themes_change_colours_and_nothing_else(name: str) -> None:
    def numbers(figure: go.Figure) -> list[Any]:
        return [(drawn.type, drawn.name, list(coordinates(go.Figure(drawn)))) for drawn in figure.data]

    light, dark = FIGURES[name]("light"), FIGURES[name]("dark")
    assert numbers(light) == numbers(dark)
    assert light.layout.template != dark.layout.template


@pytest.mark.parametrize("name", FIGURES)
def test_an_unknown_theme_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="unknown theme"):
        FIGURES[name]("midnight")


@pytest.mark.parametrize("draw", [figures.routing_figure, figures.scales_figure, figures.cmaes_figure])
def test_long_searches_are_thinned(draw: Any) -> None:
    figure = draw(trace(evaluations=3000))
    assert max(len(drawn.x) for drawn in figure.data if drawn.type == "scatter") <= LIMIT
