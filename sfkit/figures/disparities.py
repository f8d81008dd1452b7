"""What does each network see, and where is it wrong? Disparity and error maps of one pair."""

from __future__ import annotations

from html import escape

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.labels import score_text
from sfkit.figures.colours import (
    DISPARITY,
    ERROR,
    ERROR_SPAN,
    Stops,
    averaged,
    embedded,
    error_position,
    paint,
    picked,
    plotly_scale,
)
from sfkit.figures.theme import finish


def disparity_figure(
    panels: DisparityPanels, *, theme: str = "auto", resolution: int = 640, width: int = 1000
) -> go.Figure:
    """Draw left image and ground truth, and below them each network's disparity and error.

    All disparities share one colour range in pixels. Errors change colour at the threshold: blue is
    within it, orange beyond. Where there is no ground truth the picture is hatched grey. All panels zoom
    and pan together.

    Args:
        panels: from :func:`~sfkit.analysis.disparities.disparity_panels`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        resolution: longest side of the embedded pictures in pixels; larger ones lose rows and columns.
        width: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    rows = 1 + len(panels.networks)
    panel = (width - 150) / 2 * panels.truth.shape[0] / panels.truth.shape[1]
    height = round(rows * (panel + 34) + 114)
    figure = make_subplots(
        rows=rows,
        cols=2,
        horizontal_spacing=0.02,
        vertical_spacing=34 / height,
        subplot_titles=["left image", "ground truth", *_titles(panels)],
        shared_xaxes="all",
        shared_yaxes="all",
    )
    truth = paint(picked(panels.truth, resolution), panels.limits, DISPARITY)
    _picture(figure, panels, embedded(averaged(panels.left, resolution), photograph=True), 1, 1, "left image")
    _picture(figure, panels, embedded(truth), 1, 2, "ground truth")
    for number, network in enumerate(panels.networks, start=2):
        _network(figure, panels, network, number, resolution)
    _frame(figure, panels)
    _keys(figure, panels)
    return finish(
        figure,
        theme=theme,
        title=f"Where is each network wrong on {escape(panels.benchmark)}, pair {escape(panels.pair)}?",
        subtitle=f"pixels counted by protocol {panels.protocol}; grey hatch: no ground truth; "
        "beyond a bar's ends its end colour",
        height=height,
        width=width,
        margin={"l": 20, "r": 120, "t": 104, "b": 10},
        showlegend=False,
    )


def _titles(panels: DisparityPanels) -> list[str]:
    titles = []
    for network in panels.networks:
        scores = ", ".join(score_text(metric, score) for metric, score in network.scores.items())
        titles += [f"{escape(network.name)}: disparity", f"{escape(network.name)}: error ({scores})"]
    return titles


def _network(
    figure: go.Figure, panels: DisparityPanels, network: NetworkMaps, row: int, resolution: int
) -> None:
    seen = np.where(np.isfinite(network.disparity), network.disparity, np.float32(np.nan))
    disparity = paint(picked(seen, resolution), panels.limits, DISPARITY)
    error = picked(network.error, resolution)
    position = np.where(np.isnan(error), np.nan, error_position(error, panels.threshold))
    wrong = paint(position, (-ERROR_SPAN, ERROR_SPAN), ERROR)
    _picture(figure, panels, embedded(disparity), row, 1, f"{network.name}: disparity")
    _picture(figure, panels, embedded(wrong), row, 2, f"{network.name}: error")


def _picture(
    figure: go.Figure, panels: DisparityPanels, source: str, row: int, column: int, name: str
) -> None:
    """A picture spread over the pair's full size, so that axes count the pair's own pixels."""
    height, width = panels.truth.shape
    figure.add_layout_image(
        {
            "source": source,
            "x": 0,
            "y": 0,
            "sizex": width,
            "sizey": height,
            "xanchor": "left",
            "yanchor": "top",
            "sizing": "stretch",
            "layer": "below",
            "name": name,
        },
        row=row,
        col=column,
    )


def _frame(figure: go.Figure, panels: DisparityPanels) -> None:
    height, width = panels.truth.shape
    bare = {"showticklabels": False, "ticks": "", "showgrid": False, "showline": False}
    figure.update_xaxes(range=[0, width], constrain="domain", **bare)
    figure.update_yaxes(range=[height, 0], constrain="domain", **bare)
    figure.update_yaxes(scaleanchor="x", scaleratio=1, row=1, col=1)
    figure.update_annotations(font_size=12)


def _keys(figure: go.Figure, panels: DisparityPanels) -> None:
    """Two colour bars, carried by traces without a visible point."""
    low, high = panels.limits
    octaves = np.arange(-ERROR_SPAN, ERROR_SPAN + 1)
    labels = [f"{panels.threshold * 2.0**octave:.3g}" for octave in octaves]
    labels[0], labels[-1] = f"≤ {labels[0]}", f"≥ {labels[-1]}"
    _key(figure, "disparity (px)", DISPARITY, (low, high), 1.0, None)
    _key(figure, "error (px)", ERROR, (-ERROR_SPAN, ERROR_SPAN), 0.48, (octaves.tolist(), labels))


def _key(
    figure: go.Figure,
    title: str,
    stops: Stops,
    limits: tuple[float, float],
    top: float,
    ticks: tuple[list[float], list[str]] | None,
) -> None:
    bar = {
        "title": {"text": title, "side": "right"},
        "y": top,
        "yanchor": "top",
        "len": 0.46,
        "thickness": 12,
        "outlinewidth": 0,
    }
    if ticks is not None:
        bar |= {"tickvals": ticks[0], "ticktext": ticks[1]}
    figure.add_trace(
        go.Scatter(
            x=[None],
            y=[None],
            mode="markers",
            marker={
                "color": [limits[0]],
                "cmin": limits[0],
                "cmax": limits[1],
                "colorscale": plotly_scale(stops),
                "showscale": True,
                "colorbar": bar,
            },
            name=title,
            hoverinfo="skip",
        ),
        row=1,
        col=1,
    )
