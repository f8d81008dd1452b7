"""The disparity figure: what its embedded pictures show, pixel by pixel."""

from __future__ import annotations

import base64
from dataclasses import replace

import cv2
import numpy as np
import plotly.graph_objects as go
import pytest
from figure_records import panels, versus
from numpy.typing import NDArray

from sfkit.analysis.differences import advantage_panels
from sfkit.analysis.disparities import NetworkMaps
from sfkit.colours import DISPARITY, ERROR, colour_at, hatch
from sfkit.figures import advantage_figure, disparity_figure


def picture(figure: go.Figure, name: str) -> NDArray[np.uint8]:
    """An embedded picture as (H, W, 3) RGB."""
    (image,) = [image for image in figure.layout.images if image.name == name]
    code = base64.b64decode(image.source.partition(",")[2])
    decoded = cv2.imdecode(np.frombuffer(code, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded[..., ::-1], dtype=np.uint8)


def test_truth_has_its_colour_and_what_is_unknown_is_hatched() -> None:
    shown = picture(disparity_figure(panels()), "ground truth")
    assert shown.shape == (20, 40, 3)
    np.testing.assert_array_equal(shown[:, :20], hatch(20, 40)[:, :20])
    assert (shown[:, 20:] == colour_at(DISPARITY, 0.25)).all()


def test_no_error_is_not_drawn_like_no_truth() -> None:
    shown = picture(disparity_figure(panels()), "fine: error")
    np.testing.assert_array_equal(shown[:, :20], hatch(20, 40)[:, :20])
    assert (shown[1:, 20:] == colour_at(ERROR, 0.0)).all()


def test_a_prediction_that_is_not_finite_is_as_wrong_as_can_be() -> None:
    shown = picture(disparity_figure(panels()), "<i>broken</i>: error")
    assert tuple(shown[0, -1]) == colour_at(ERROR, 1.0)


def test_every_network_has_two_panels_with_its_scores() -> None:
    figure = disparity_figure(panels())
    assert len(figure.layout.images) == 2 + 2 * 2
    texts = [note.text for note in figure.layout.annotations]
    assert texts[:3] == ["left image", "ground truth", "fine: disparity"]
    assert texts[3] == "fine: error (bad-1.0 12.35 %, EPE 0.50 px)"
    assert texts[4] == "&lt;i&gt;broken&lt;/i&gt;: disparity"
    assert figure.layout.title.text == "Where is each network wrong on world, pair pair &lt;0&gt;?"
    assert "all-valid" in figure.layout.title.subtitle.text


def test_two_labelled_bars_in_pixels() -> None:
    bars = [drawn.marker for drawn in disparity_figure(panels()).data]
    assert [bar.colorbar.title.text for bar in bars] == ["disparity (px)", "error (px)"]
    assert (bars[0].cmin, bars[0].cmax) == (1.0, 5.0)
    assert tuple(bars[1].colorbar.ticktext) == ("≤ 0.125", "0.25", "0.5", "1", "2", "4", "≥ 8")


def test_panels_zoom_together_in_pixels_of_the_pair() -> None:
    figure = disparity_figure(panels())
    matched = {axis.matches for axis in figure.select_xaxes()} - {None}
    assert len(matched) == 1
    assert tuple(figure.layout.xaxis.range) == (0, 40)
    assert tuple(figure.layout.yaxis.range) == (20, 0)
    assert {image.sizex for image in figure.layout.images} == {40}


@pytest.mark.parametrize(("resolution", "size"), [(640, (20, 40)), (20, (10, 20)), (15, (7, 14))])
def test_large_pictures_are_thinned(resolution: int, size: tuple[int, int]) -> None:
    figure = disparity_figure(panels(), resolution=resolution)
    assert picture(figure, "ground truth").shape[:2] == size
    assert picture(figure, "left image").shape[:2] == size


def test_the_signed_map_is_light_where_nothing_changed_and_hatched_where_nothing_counts() -> None:
    shown = picture(advantage_figure(versus()), "difference")
    np.testing.assert_array_equal(shown[:, :20], hatch(20, 40)[:, :20])
    assert (shown[1:, 20:] == colour_at(ERROR, 0.5)).all()


def test_better_is_blue_and_worse_is_orange() -> None:
    pair = panels()
    error = np.where(np.isnan(pair.truth), np.float32(np.nan), np.float32(3.0))
    names = {"off by 3": error, "exact": error - 3}
    networks = tuple(NetworkMaps(name, pair.truth, held, {}) for name, held in names.items())
    made = replace(pair, networks=networks)
    better = advantage_figure(advantage_panels(made, "off by 3", "exact"))
    assert (picture(better, "difference")[:, 20:] == colour_at(ERROR, 1 / 8)).all()
    assert "100.0 % of the pixels was fixed, of 0.0 % broken" in better.layout.title.subtitle.text
    worse = advantage_figure(advantage_panels(made, "exact", "off by 3"))
    assert (picture(worse, "difference")[:, 20:] == colour_at(ERROR, 7 / 8)).all()
    (bar,) = [drawn.marker for drawn in worse.data]
    assert (bar.cmin, bar.cmax, bar.colorbar.title.text) == (-4.0, 4.0, "change of error (px)")
