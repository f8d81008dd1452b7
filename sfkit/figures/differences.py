"""Where is one network better than another? The signed map of two error maps, in a figure and as files."""

from __future__ import annotations

from html import escape

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from sfkit.analysis.differences import AdvantagePanels
from sfkit.colours import ERROR, embedded, paint, painted_disparity, painted_error, picked, shrunk
from sfkit.figures.pictures import add_colour_bar, add_picture, frame_pictures
from sfkit.figures.theme import finish

ADVANTAGE_SPAN = 4.0
"""A map of differences runs from -4 to 4 times the threshold."""

PICTURES = ("a_disparity", "b_disparity", "a_error", "b_error", "better")
"""Of a pair: what both networks predict in one colour range, where each is wrong, and where b is nearer."""


def advantage_figure(
    panels: AdvantagePanels, *, theme: str = "auto", resolution: int = 640, width: int = 1000
) -> go.Figure:
    """Draw the left image, and beside it the network's error minus the reference's.

    Blue is where the network is nearer to the ground truth, orange where the reference is. Where there is
    no ground truth the picture is hatched grey. Both panels zoom and pan together.

    Args:
        panels: from :func:`~sfkit.analysis.differences.advantage_panels`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        resolution: longest side of the embedded pictures in pixels; larger ones lose rows and columns.
        width: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    pair, found, kind = panels.pair, panels.advantage, panels.pair.kind
    size = pair.truth.shape
    network, reference = escape(panels.network), escape(panels.reference)
    titles = ["left image", f"{network} against {reference}"]
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.02,
        subplot_titles=titles,
        # All: a zoom into one panel is one into every panel.
        shared_xaxes="all",
        shared_yaxes="all",
    )
    span = ADVANTAGE_SPAN * pair.threshold
    signed = paint(picked(found.difference, resolution), (-span, span), ERROR)
    photograph = embedded(shrunk(pair.left, resolution), photograph=True)
    add_picture(figure, size, photograph, 1, 1, "left image")
    add_picture(figure, size, embedded(signed), 1, 2, "difference")
    frame_pictures(figure, size)
    add_colour_bar(figure, f"change of {kind.name} ({kind.unit})", ERROR, (-span, span))
    return finish(
        figure,
        theme=theme,
        title=f"Where is {network} better than {reference} on {escape(pair.benchmark)}, "
        f"pair {escape(pair.pair)}?",
        subtitle=f"blue: better; beyond {pair.threshold:g} {kind.unit} the {kind.name} of "
        f"{found.fixed:.1f} % of the pixels was fixed, of {found.broken:.1f} % broken; "
        f"protocol {pair.protocol}; grey hatch: {pair.hatched}",
        # Two panels share what margins and key leave of the width, at the pair's ratio.
        height=round((width - 150) / 2 * size[0] / size[1] + 150),
        width=width,
        margin={"l": 20, "r": 120, "t": 104, "b": 10},
        showlegend=False,
    )


def pair_pictures(panels: AdvantagePanels) -> dict[str, NDArray[np.uint8]]:
    """The pictures of ``PICTURES``, each (H, W, 3) RGB uint8; a is the reference, b the other network.

    Errors are blue below the threshold and orange above. ``better`` is blue where b is nearer to the ground
    truth, orange where a is. What has no value is hatched grey.
    """
    pair, span = panels.pair, ADVANTAGE_SPAN * panels.pair.threshold
    maps = {network.name: network for network in pair.networks}
    a, b = maps[panels.reference], maps[panels.network]
    better = paint(panels.advantage.difference, (-span, span), ERROR)
    disparities = (painted_disparity(one.disparity, pair.limits) for one in (a, b))
    errors = (painted_error(one.error, pair.threshold) for one in (a, b))
    return dict(zip(PICTURES, (*disparities, *errors, better), strict=True))
