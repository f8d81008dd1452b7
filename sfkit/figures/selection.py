"""Which sources do searches choose, and with what weight?"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.selection import SelectionStatistics
from sfkit.colours import SHARE
from sfkit.figures.heatmaps import CELL, matrix
from sfkit.figures.theme import ACCENT, LOOKS, WARM, finish, read_theme


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
    sources = list(statistics.sources)
    lower = CELL * len(statistics.runs)
    figure = make_subplots(
        rows=2,
        cols=1,
        shared_xaxes=True,
        # In pixels: plotly takes them as shares of their sum.
        row_heights=[170, max(lower, 80)],
        vertical_spacing=0.05,
    )
    bars = (
        ("runs that chose it", ACCENT, 100.0 * statistics.frequency),
        # A source that no run chose has a bar of no height.
        ("weight when chosen", WARM, 100.0 * np.nan_to_num(statistics.weight_when_chosen)),
    )
    for name, colour, values in bars:
        figure.add_bar(
            x=sources,
            y=values.tolist(),
            name=name,
            marker={"color": colour, "line": {"width": 0}},
            hovertemplate=f"%{{x}}: %{{y:.0f}} % {name}<extra></extra>",
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
    # Stable: of equals the pool's order.
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


def rivals_figure(
    statistics: SelectionStatistics, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw each source's frequency and mean weight, and its strongest competitor's (figure 5 of the paper).

    Args:
        statistics: from :func:`~sfkit.analysis.selection.selection_statistics`, over validation settings.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of sources unless given.

    Raises:
        InputError: an unknown theme.
    """
    muted = LOOKS[read_theme(theme)].muted
    table = statistics.rivals()
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.05)
    for col, name in enumerate(("chosen (%)", "mean weight (%)"), start=1):
        own, other = table[name], table[f"its {name}"]
        for x0, x1, source in zip(own, other, table.index, strict=True):
            line = {"color": muted, "width": 1}
            figure.add_scatter(
                x=[x0, x1],
                y=[source] * 2,
                mode="lines",
                line=line,
                hoverinfo="skip",
                showlegend=False,
                row=1,
                col=col,
            )
        for values, label, symbol, colour in (
            (other, "its strongest competitor", "diamond-open", WARM),
            (own, "the source", "circle", ACCENT),
        ):
            figure.add_scatter(
                x=values.tolist(),
                y=table.index.tolist(),
                mode="markers",
                name=label,
                legendgroup=label,
                showlegend=col == 1,
                marker={
                    "symbol": symbol,
                    "size": 10,
                    "color": colour,
                    "line": {"color": colour, "width": 2},
                },
                text=table["strongest other"].tolist() if values is other else table.index.tolist(),
                hovertemplate="%{text}: %{x:.0f} %<extra>" + label + "</extra>",
                row=1,
                col=col,
            )
        figure.update_xaxes(title_text=name, range=[-4, 104] if col == 1 else None, row=1, col=col)
    figure.update_yaxes(type="category", autorange="reversed")
    figure.update_yaxes(title_text="source", row=1, col=1)
    runs = len(statistics.runs)
    always = [n for n, share in zip(statistics.sources, statistics.frequency, strict=True) if share == 1.0]
    common = f"chosen by all: {', '.join(always)}" if always else "no source is chosen by all"
    return finish(
        figure,
        theme=theme,
        title="Is any source needed whatever guides?",
        subtitle=f"{runs} searches; {common}",
        height=height or 26 * len(statistics.sources) + 230,
    )
