"""What does merging change in the picture? Benchmarks by networks, as disparity maps."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.disparities import DisparityPanels
from sfkit.analysis.labels import score_text
from sfkit.colours import embedded, painted_disparity, picked, shrunk
from sfkit.errors import InputError
from sfkit.figures.pictures import BARE, add_picture
from sfkit.figures.theme import finish

ROW = 150
"""Height of one benchmark's pictures in pixels."""


def qualitative_figure(
    rows: Sequence[DisparityPanels], *, theme: str = "auto", resolution: int = 320
) -> go.Figure:
    """Draw a row a benchmark: its image, then every network's disparity, with its score on that pair.

    The disparities of a row share one range, from dark and far to bright and near.

    Args:
        rows: from :func:`~sfkit.analysis.qualitative.qualitative_grid`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        resolution: longest side of the embedded pictures in pixels.

    Raises:
        InputError: no row, rows of different networks, or an unknown theme.
    """
    columns = {tuple(one.name for one in row.networks) for row in rows}
    if len(columns) != 1:
        raise InputError(
            f"pictures: found rows of {len(columns)} sets of networks, expected one that all rows show"
        )
    (names,) = columns
    figure = make_subplots(
        rows=len(rows),
        cols=1 + len(names),
        horizontal_spacing=0.008,
        # 28 px a row for its titles, as a share of the height.
        vertical_spacing=28 / (len(rows) * (ROW + 28)),
        subplot_titles=[title for row in rows for title in ("image", *_titles(row))],
    )
    for number, row in enumerate(rows, start=1):
        size = row.truth.shape
        photograph = embedded(shrunk(row.left, resolution), photograph=True)
        add_picture(figure, size, photograph, number, 1, "image")
        for column, one in enumerate(row.networks, start=2):
            painted = embedded(painted_disparity(picked(one.disparity, resolution), row.limits))
            add_picture(figure, size, painted, number, column, one.name)
        for column in range(1, 2 + len(names)):
            _frame(figure, size, number, column)
        figure.update_yaxes(title_text=escape(row.benchmark), row=number, col=1)
    done = finish(
        figure,
        theme=theme,
        title="What does merging change in the picture?",
        subtitle=f"columns: image, {escape(', '.join(names))}; numbers: the pair's own score; bright is near",
        height=len(rows) * (ROW + 28) + 130,
        margin={"l": 50, "r": 10, "t": 104, "b": 20},
        showlegend=False,
    )
    return done.update_annotations(font_size=11)  # pictures are small


def _titles(row: DisparityPanels) -> list[str]:
    return [
        f"{escape(one.name)}: {', '.join(score_text(metric, score) for metric, score in one.scores.items())}"
        for one in row.networks
    ]


def _frame(figure: go.Figure, size: tuple[int, int], row: int, column: int) -> None:
    """Bare axes in pixels of the pair, stretched to the cell, as the paper's figure does."""
    figure.update_xaxes(range=[0, size[1]], row=row, col=column, **BARE)
    figure.update_yaxes(range=[size[0], 0], row=row, col=column, **BARE)
    # plotly draws no axes where there is no trace.
    figure.add_scatter(x=[None], y=[None], hoverinfo="skip", row=row, col=column)
