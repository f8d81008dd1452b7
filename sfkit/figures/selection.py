"""Which sources do searches choose, and with what weight?"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.selection import SelectionStatistics
from sfkit.colours import SHARE
from sfkit.figures.heatmaps import CELL, matrix
from sfkit.figures.theme import ACCENT, WARM, finish, read_theme


def selection_figure(
    statistics: SelectionStatistics, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw how often searches chose each source, and with what weight, over each single run.

    Args:
        statistics: from :func:`~sfkit.analysis.selection.selection_statistics`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of runs unless given.

    Raises:
        InputError: an unknown theme.
    """
    read_theme(theme)
    sources = list(statistics.sources)
    lower = CELL * len(statistics.runs)
    figure = make_subplots(
        rows=2,
        cols=1,
        shared_xaxes=True,
        row_heights=[170, max(lower, 80)],
        vertical_spacing=0.05,
    )
    bars = (
        ("runs that chose it", ACCENT, 100.0 * statistics.frequency),
        ("weight when chosen", WARM, 100.0 * np.nan_to_num(statistics.weight_when_chosen)),
    )
    for name, colour, values in bars:
        figure.add_trace(
            go.Bar(
                x=sources,
                y=values.tolist(),
                name=name,
                marker={"color": colour, "line": {"width": 0}},
                hovertemplate=f"%{{x}}: %{{y:.0f}} % {name}<extra></extra>",
            ),
            row=1,
            col=1,
        )
    weights = np.where(statistics.chosen, 100.0 * statistics.weights, np.nan)
    figure.add_trace(
        matrix(
            weights,
            statistics.runs,
            sources,
            name="weight",
            unit="weight (%)",
            stops=SHARE,
            limits=(0.0, max(1.0, float(np.nanmax(weights)))),
            form=".0f",
            hover="%{y}: %{x} has %{z:.1f} %",
            bar={"len": 0.6, "y": 0.0, "yanchor": "bottom"},
        ),
        row=2,
        col=1,
    )
    figure.update_yaxes(title_text="share (%)", range=[0, 100], row=1, col=1)
    figure.update_yaxes(type="category", autorange="reversed", title_text="run", row=2, col=1)
    figure.update_xaxes(type="category", title_text="source", row=2, col=1)
    order = np.argsort(-statistics.frequency, kind="stable")[:3]
    most = ", ".join(f"{sources[n]} ({100 * statistics.frequency[n]:.0f} %)" for n in order)
    overlap = f"; two runs' subsets overlap by {100 * statistics.overlap:.0f} %" if len(weights) > 1 else ""
    return finish(
        figure,
        theme=theme,
        title="Which sources do searches choose, and with what weight?",
        subtitle=f"most often: {most}{overlap}; blank: not chosen",
        height=height or 170 + max(lower, 80) + 240,
        barmode="group",
        margin={"b": 130},
    )
