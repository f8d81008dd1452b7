"""What does each network see, and where is it wrong? Disparity and error maps of one pair."""

from __future__ import annotations

from html import escape

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.labels import score_text
from sfkit.colours import (
    DISPARITY,
    ERROR,
    ERROR_SPAN,
    embedded,
    paint,
    painted_disparity,
    painted_error,
    picked,
    shrunk,
)
from sfkit.figures.pictures import add_colour_bar, add_picture, frame_pictures
from sfkit.figures.theme import finish


def disparity_figure(
    panels: DisparityPanels, *, theme: str = "auto", resolution: int = 640, width: int = 1000
) -> go.Figure:
    """Draw left image and ground truth, and below them each network's disparity and error.

    All disparities share one colour range in pixels. Errors change colour at the threshold: blue is
    within it, orange beyond. Where there is no ground truth the picture is hatched grey. All panels zoom
    and pan together. Of a pair without any ground truth the right image and residuals are drawn.

    Args:
        panels: from :func:`~sfkit.analysis.disparities.disparity_panels`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        resolution: longest side of the embedded pictures in pixels; larger ones lose rows and columns.
        width: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    second = "ground truth" if panels.right is None else "right image"
    rows = 1 + len(panels.networks)
    panel = (width - 150) / 2 * panels.truth.shape[0] / panels.truth.shape[1]
    # 34 px above each row hold its titles, 114 are the margins.
    height = round(rows * (panel + 34) + 114)
    figure = make_subplots(
        rows=rows,
        cols=2,
        horizontal_spacing=0.02,
        vertical_spacing=34 / height,
        subplot_titles=["left image", second, *_titles(panels)],
        # All: a zoom into one panel is one into every panel.
        shared_xaxes="all",
        shared_yaxes="all",
    )
    photograph = embedded(shrunk(panels.left, resolution), photograph=True)
    add_picture(figure, panels.truth.shape, photograph, 1, 1, "left image")
    add_picture(figure, panels.truth.shape, _compared_with(panels, resolution), 1, 2, second)
    for number, network in enumerate(panels.networks, start=2):
        _network(figure, panels, network, number, resolution)
    frame_pictures(figure, panels.truth.shape)
    _keys(figure, panels)
    return finish(
        figure,
        theme=theme,
        title=f"Where is each network wrong on {escape(panels.benchmark)}, pair {escape(panels.pair)}?",
        subtitle=f"pixels counted by protocol {panels.protocol}; grey hatch: {panels.hatched}; "
        "beyond a bar's ends its end colour",
        height=height,
        width=width,
        margin={"l": 20, "r": 120, "t": 104, "b": 10},
        showlegend=False,
    )


def _compared_with(panels: DisparityPanels, resolution: int) -> str:
    if panels.right is not None:
        return embedded(shrunk(panels.right, resolution), photograph=True)
    return embedded(paint(picked(panels.truth, resolution), panels.limits, DISPARITY))


def _titles(panels: DisparityPanels) -> list[str]:
    titles = []
    for network in panels.networks:
        scores = ", ".join(score_text(metric, score) for metric, score in network.scores.items())
        name = escape(network.name)
        titles += [f"{name}: disparity", f"{name}: {panels.kind.name} ({scores})"]
    return titles


def _network(
    figure: go.Figure, panels: DisparityPanels, network: NetworkMaps, row: int, resolution: int
) -> None:
    size = panels.truth.shape
    disparity = painted_disparity(picked(network.disparity, resolution), panels.limits)
    wrong = painted_error(picked(network.error, resolution), panels.threshold)
    add_picture(figure, size, embedded(disparity), row, 1, f"{network.name}: disparity")
    add_picture(figure, size, embedded(wrong), row, 2, f"{network.name}: {panels.kind.name}")


def _keys(figure: go.Figure, panels: DisparityPanels) -> None:
    low, high = panels.limits
    octaves = np.arange(-ERROR_SPAN, ERROR_SPAN + 1)
    labels = [f"{panels.threshold * 2.0**octave:.3g}" for octave in octaves]
    # What lies beyond takes the colours of the ends.
    labels[0], labels[-1] = f"≤ {labels[0]}", f"≥ {labels[-1]}"
    add_colour_bar(figure, "disparity (px)", DISPARITY, (low, high), length=0.46)
    ends, ticks = (-ERROR_SPAN, ERROR_SPAN), (octaves.tolist(), labels)
    add_colour_bar(
        figure, f"{panels.kind.name} ({panels.kind.unit})", ERROR, ends, top=0.48, length=0.46, ticks=ticks
    )
