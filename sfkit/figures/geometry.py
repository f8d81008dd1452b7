"""How far did each source go, and whose ways agree? Norms by block, cosines between sources."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.geometry import TaskVectorGeometry
from sfkit.colours import OPPOSED, SHARE
from sfkit.figures.heatmaps import CELL, matrix
from sfkit.figures.theme import finish


def geometry_figure(
    geometry: TaskVectorGeometry, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw task vectors: cosines between sources on the left, relative norms by block on the right.

    Args:
        geometry: from :func:`~sfkit.analysis.geometry.task_vector_geometry`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of sources unless given.

    Raises:
        InputError: an unknown theme.
    """
    sources = geometry.sources
    labels = [
        f"{block}<br>{100 * share:.0f} % conflict"
        for block, share in zip(geometry.blocks, geometry.conflicts, strict=True)
    ]
    figure = make_subplots(
        rows=1,
        cols=2,
        column_widths=[0.62, 0.38],
        shared_yaxes=True,
        horizontal_spacing=0.16,
        subplot_titles=["cosine between task vectors", "norm in % of the base's"],
    )
    cosines = geometry.cosines.copy()
    np.fill_diagonal(cosines, np.nan)  # 1 by definition, and would take all the colour
    # Each beside its own panel; plotly would put both at the right edge.
    bars = [{"x": 0.535, "xanchor": "left"}, {"x": 1.01, "xanchor": "left"}]
    figure.add_trace(
        matrix(
            cosines,
            sources,
            sources,
            name="cosine",
            unit="cosine (-1 opposite, 1 the same way)",
            stops=OPPOSED,
            limits=(-1.0, 1.0),
            form=".2f",
            bar=bars[0],
        ),
        row=1,
        col=1,
    )
    relative = geometry.relative.T
    top = float(np.nanmax(relative)) if np.isfinite(relative).any() else 1.0
    figure.add_trace(
        matrix(
            relative,
            sources,
            labels,
            name="norm",
            unit="norm (% of the base's)",
            stops=SHARE,
            limits=(0.0, top),
            hover="%{y}, %{x}: %{z:.1f} %",
            bar=bars[1],
        ),
        row=1,
        col=2,
    )
    # plotly counts upwards; the first source stands on top, as in tables.
    figure.update_yaxes(type="category", autorange="reversed")
    figure.update_yaxes(title_text="source", row=1, col=1)
    figure.update_xaxes(type="category", tickangle=-40)
    figure.update_xaxes(title_text="source", row=1, col=1)
    figure.update_xaxes(title_text="block", row=1, col=2)
    return finish(
        figure,
        theme=theme,
        title="How far did each source go, and whose ways agree?",
        subtitle=_answer(geometry),
        height=height or CELL * len(sources) + 330,
        margin={"b": 130, "r": 70},
    )


def _answer(geometry: TaskVectorGeometry) -> str:
    count = len(geometry.sources)
    if count < 2:
        return "one source: there is nothing to agree with"
    # Each pair once, and none with itself.
    upper = geometry.cosines[np.triu_indices(count, 1)]
    return (
        f"cosines from {np.nanmin(upper):.2f} to {np.nanmax(upper):.2f}; signs conflict in "
        f"{100 * geometry.conflict:.0f} % of the parameters that two sources or more moved"
    )
