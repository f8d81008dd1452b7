"""Pictures of one pair in a plotly figure: panels that zoom together, and colour bars beside them."""

from __future__ import annotations

import plotly.graph_objects as go

from sfkit.colours import Stops, plotly_scale

BARE = {"showticklabels": False, "ticks": "", "showgrid": False, "showline": False}
"""Axes of a picture."""


def add_picture(
    figure: go.Figure, size: tuple[int, int], source: str, row: int, column: int, name: str
) -> None:
    """A picture spread over the pair's full size (H, W), so that axes count the pair's own pixels."""
    height, width = size
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
            # So that whatever is drawn on it stays in sight.
            "layer": "below",
            "name": name,
        },
        row=row,
        col=column,
    )


def frame_pictures(figure: go.Figure, size: tuple[int, int]) -> None:
    """Bare axes in pixels of the pair (H, W), rows downwards, all at one scale."""
    height, width = size
    figure.update_xaxes(range=[0, width], constrain="domain", **BARE)
    figure.update_yaxes(range=[height, 0], constrain="domain", **BARE)
    for axis in figure.select_yaxes():
        if axis.matches is None:  # plotly ignores, and warns of, a scale on axes that follow another
            axis.update(scaleanchor=axis.anchor, scaleratio=1)


def add_colour_bar(
    figure: go.Figure,
    title: str,
    stops: Stops,
    limits: tuple[float, float],
    *,
    top: float = 1.0,
    length: float = 1.0,
    ticks: tuple[list[float], list[str]] | None = None,
) -> None:
    """A colour bar of a map, carried by a trace without a visible point.

    Args:
        figure: to add it to.
        title: with the unit.
        stops: the colour map.
        limits: values at its ends.
        top: its upper end, as a share of the figure's plotting height.
        length: its length, likewise.
        ticks: values and texts; plotly's own unless given.
    """
    bar = {
        "title": {"text": title, "side": "right"},
        "y": top,
        "yanchor": "top",
        "len": length,
        "thickness": 12,
        "outlinewidth": 0,
    }
    if ticks is not None:
        bar |= {"tickvals": ticks[0], "ticktext": ticks[1]}
    # A point without a place carries the bar, which pictures cannot have.
    figure.add_scatter(
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
        row=1,
        col=1,
    )
