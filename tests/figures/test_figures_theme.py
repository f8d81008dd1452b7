"""Themes and colour maps: contrast on both pages, by the WCAG formula; painting by hand values."""

from __future__ import annotations

import base64
import itertools
import re

import cv2
import numpy as np
import pytest

from sfkit.colours import (
    DISPARITY,
    ERROR,
    SHARE,
    Stops,
    colour_at,
    embedded,
    error_position,
    hatch,
    lookup,
    paint,
    picked,
    shrunk,
    text_on,
)
from sfkit.errors import InputError
from sfkit.figures.axes import beyond, log_ticks, whole_ticks
from sfkit.figures.theme import ACCENT, FAILED, LOOKS, SERIES, WARM, Theme, series_style, template

WHITE, NIGHT = (255, 255, 255), (17, 17, 17)
PAGES = {Theme.LIGHT: [WHITE], Theme.DARK: [NIGHT], Theme.AUTO: [WHITE, NIGHT]}


def under(paper: str, page: tuple[int, int, int]) -> tuple[int, int, int]:
    """What one sees of a page through a paper."""
    *colour, opacity = (float(part) for part in paper.removeprefix("rgba(").removesuffix(")").split(","))
    red, green, blue = (round(opacity * c + (1 - opacity) * p) for c, p in zip(colour, page, strict=True))
    return red, green, blue


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def luminance(colour: tuple[int, int, int]) -> float:
    parts = [v / 255 for v in colour]
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def contrast(one: tuple[int, int, int], other: tuple[int, int, int]) -> float:
    low, high = sorted([luminance(one), luminance(other)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", list(Theme))
def test_text_reads_on_every_page_of_its_theme(theme: Theme) -> None:
    look = LOOKS[theme]
    for page in PAGES[theme]:
        seen = under(look.paper, page)
        assert contrast(rgb(look.ink), seen) >= 7.0
        assert contrast(rgb(look.muted), seen) >= 4.5


@pytest.mark.parametrize("colour", [*SERIES, ACCENT, WARM, FAILED])
def test_lines_and_marks_read_on_light_and_dark(colour: str) -> None:
    card = under(LOOKS[Theme.AUTO].paper, NIGHT)
    assert min(contrast(rgb(colour), page) for page in (WHITE, NIGHT, card)) >= 3.0


@pytest.mark.parametrize("theme", ["light", "dark", "auto"])
def test_templates_have_their_theme_s_paper_and_not_plotlys_own(theme: str) -> None:
    layout = template(theme).layout
    assert layout.plot_bgcolor == "rgba(0,0,0,0)"
    assert layout.paper_bgcolor == LOOKS[Theme(theme)].paper
    assert layout.font.color == LOOKS[Theme(theme)].ink
    assert layout.xaxis.gridcolor == layout.yaxis.gridcolor == LOOKS[Theme(theme)].rule


def test_an_unknown_theme_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match="unknown theme 'drak', expected one of: auto, dark, light; did you"):
        template("drak")


def test_two_dozen_lines_differ() -> None:
    styles = [tuple(series_style(n).items()) for n in range(24)]
    assert len(set(styles)) == 24


@pytest.mark.parametrize("stops", [DISPARITY, SHARE])
def test_sequential_maps_rise_in_lightness_without_help_from_hue(stops: Stops) -> None:
    steps = np.diff([luminance(tuple(int(v) for v in colour)) for colour in lookup(stops)[::15]])  # type: ignore[arg-type]
    assert (steps > 0).all()


def test_the_error_map_is_lightest_at_its_threshold_and_its_ends_differ_in_blue_and_red() -> None:
    lightness = [luminance(colour_at(ERROR, at)) for at in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert max(lightness) == lightness[2]
    assert colour_at(ERROR, 0.0)[2] > colour_at(ERROR, 0.0)[0]
    assert colour_at(ERROR, 1.0)[0] > colour_at(ERROR, 1.0)[2]


@pytest.mark.parametrize("stops", [DISPARITY, ERROR, SHARE])
def test_figures_in_cells_read_on_every_colour(stops: Stops) -> None:
    for position in np.linspace(0, 1, 101):
        colour = colour_at(stops, float(position))
        assert contrast(rgb(text_on(colour)), colour) >= 4.5


def test_errors_are_placed_by_octaves_around_the_threshold() -> None:
    errors = np.array([0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 16.0, np.inf])
    np.testing.assert_allclose(error_position(errors, 2.0), [-3, -3, -2, -1, 0, 1, 3, 3])


def test_painting_ends_clips_and_hatches() -> None:
    painted = paint(np.array([[0.0, 10.0, -5.0, 99.0, np.nan]]), (0.0, 10.0), DISPARITY)
    low, high = DISPARITY[0], DISPARITY[-1]
    assert [tuple(int(v) for v in pixel) for pixel in painted[0, :4]] == [low, high, low, high]
    nothing = tuple(int(v) for v in painted[0, 4])
    assert nothing == tuple(int(v) for v in hatch(1, 5)[0, 4])
    assert len(set(nothing)) == 1


def test_sparse_values_are_painted_three_pixels_wide() -> None:
    drawn = np.random.default_rng(0).random((24, 40))
    values = np.where(drawn < 0.06, drawn / 0.06, np.nan)
    painted, alone = paint(values, (0.0, 1.0), DISPARITY), lookup(DISPARITY)
    known = np.argwhere(np.isfinite(values))
    for row, column in np.ndindex(values.shape):
        squares = ((known - (row, column)) ** 2).sum(axis=1)
        if squares.min() > 9:
            np.testing.assert_array_equal(painted[row, column], hatch(24, 40)[row, column])
            continue
        nearest = [values[tuple(at)] for at in known[squares == squares.min()]]
        colours = [tuple(alone[int(255 * value + 0.5)]) for value in nearest]
        assert tuple(painted[row, column]) in colours
    half = np.where(np.arange(8) % 2, 1.0, np.nan)[None]
    np.testing.assert_array_equal(paint(half, (0.0, 1.0), DISPARITY)[:, ::2], hatch(1, 8)[:, ::2])


@pytest.mark.parametrize("stops", [DISPARITY, ERROR])
def test_no_value_is_drawn_in_a_grey_that_the_map_does_not_have(stops: Stops) -> None:
    greys = {tuple(int(v) for v in pixel) for pixel in hatch(16, 16).reshape(-1, 3)}
    assert len(greys) == 2
    for grey, colour in itertools.product(greys, lookup(stops)):
        assert np.abs(np.array(grey, int) - colour.astype(int)).max() >= 30


def test_pixels_are_picked_and_photographs_averaged() -> None:
    values = np.array([[1.0, np.nan, 3.0, 4.0, 5.0]])
    np.testing.assert_array_equal(picked(values, 3), [[1.0, 3.0, 5.0]])
    np.testing.assert_array_equal(picked(values, 5), values)
    board = np.zeros((4, 4, 3), np.uint8)
    board[::2, ::2] = 200
    np.testing.assert_array_equal(shrunk(board, 2), np.full((2, 2, 3), 50))


def test_an_embedded_picture_decodes_to_the_same_rgb() -> None:
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    uri = embedded(image)
    head, _, code = uri.partition(",")
    assert head == "data:image/png;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    np.testing.assert_array_equal(decoded[..., ::-1], image)
    assert re.match("data:image/jpeg;", embedded(image, photograph=True))


def test_failures_are_marked_past_every_score() -> None:
    assert beyond([1.0, 3.0, float("inf"), float("nan")]) == pytest.approx(3.12)
    assert beyond([2.0]) > 2.0
    assert beyond([]) == 1.0


def test_ticks() -> None:
    assert whole_ticks(0, 0) == [0]
    assert whole_ticks(0, 15) == [0, 2, 4, 6, 8, 10, 12, 14]
    assert whole_ticks(1, 6) == [1, 2, 3, 4, 5, 6]
    assert log_ticks([0.13, 0.5, 0.0, float("inf")]) == pytest.approx([0.2, 0.5])
    assert log_ticks([0.3, 0.32]) == [0.25, 0.3, 0.35, 0.4]
    assert log_ticks([0.423, 0.5]) == [0.4, 0.5, 0.6]
    assert log_ticks([0.0]) == []
