"""Stage 2: what mixes into which block, and how strongly?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.labels import score_text
from sfkit.analysis.routings import RoutingTrace
from sfkit.colours import SHARE, colour_at, share_position, share_scale, text_on
from sfkit.errors import InputError
from sfkit.figures.theme import ACCENT, LOOKS, finish, read_theme, series_style

EVALUATION = "evaluation (number)"


def routing_figure(
    trace: RoutingTrace, *, theme: str = "auto", evaluation: int | None = None, height: int | None = None
) -> go.Figure:
    """Draw the routing weights of one recipe, and how weights moved over the search.

    Args:
        trace: from :func:`~sfkit.analysis.routings.routing_trace`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        evaluation: number of the recipe on the left; the best one unless given.
        height: of the figure in pixels; by the number of rows unless given.

    Raises:
        InputError: an unknown theme, no such evaluation, or nothing to choose as the best.
    """
    chosen = _chosen(trace, evaluation)
    rows = 1 if trace.tied else len(trace.blocks)
    figure = make_subplots(
        rows=rows,
        cols=2,
        column_widths=[0.45, 0.55],
        horizontal_spacing=0.12,
        vertical_spacing=0.2 / rows if rows > 1 else 0.0,
        # The heatmap stands beside all rows of traces.
        specs=[[{"rowspan": rows}, {}], *[[None, {}] for _ in range(rows - 1)]],
        subplot_titles=["", *(["all blocks"] if trace.tied else trace.blocks)],
    )
    _heatmap(figure, trace, chosen)
    for row in range(rows):
        _weights_over_time(figure, trace, row)
    figure.update_xaxes(title_text="source", type="category", row=1, col=1)
    figure.update_yaxes(title_text="block (× module scale)", autorange="reversed", row=1, col=1)
    # A little beyond both ends, so that lines there are whole.
    figure.update_yaxes(range=[-0.02, 1.02], col=2)
    figure.update_yaxes(title_text="weight (fraction)", row=(rows + 1) // 2, col=2)
    figure.update_xaxes(matches="x2", showticklabels=False, col=2)
    figure.update_xaxes(matches=None, row=1, col=2)  # plotly warns of an axis that is to match itself
    figure.update_xaxes(title_text=EVALUATION, showticklabels=True, row=rows, col=2)
    return finish(
        figure,
        theme=theme,
        title="Which source goes into which block?",
        subtitle=f"{_named(trace, chosen)}; right: dots are candidates, lines the best so far",
        height=height or max(420, 120 * rows + 200),
    )


def scales_figure(trace: RoutingTrace, *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw each block's module scale over the search, between the ends of its range and around 1.

    Args:
        trace: from :func:`~sfkit.analysis.routings.routing_trace`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of blocks unless given.

    Raises:
        InputError: an unknown theme.
    """
    look = LOOKS[read_theme(theme)]
    blocks = len(trace.blocks)
    figure = make_subplots(
        rows=blocks,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.2 / blocks,
        subplot_titles=list(trace.blocks),
    )
    low, high = trace.gamma
    margin = 0.06 * (high - low)
    for b in range(blocks):
        _over_time(figure, trace, trace.scales[:, b], b + 1, 1, "module scale", {"color": ACCENT}, b == 0)
        figure.update_yaxes(
            range=[low - margin, high + margin],
            tickvals=[low, 1.0, high],
            showgrid=False,
            row=b + 1,
            col=1,
        )
        # A full line at 1, where a block takes the merged task vector as it is.
        for value, dash, width in ((low, "dash", 1), (1.0, "solid", 1.5), (high, "dash", 1)):
            line = {"color": look.muted, "dash": dash, "width": width}
            figure.add_hline(y=value, line=line, layer="below", row=b + 1, col=1)
    figure.update_yaxes(title_text="scale (factor)", row=(blocks + 1) // 2, col=1)
    figure.update_xaxes(title_text=EVALUATION, row=blocks, col=1)
    return finish(
        figure,
        theme=theme,
        title="How strongly does each block take on what its sources learned?",
        subtitle="1 takes the merged task vector as it is; dots are candidates, lines the best so far",
        height=height or 110 * blocks + 170,
        showlegend=False,
        margin={"b": 60},
    )


def _chosen(trace: RoutingTrace, evaluation: int | None) -> int:
    if evaluation is None and trace.best < 0:
        raise InputError("routing: found no evaluation with a finite score, expected one: name evaluation=0")
    chosen = trace.best if evaluation is None else evaluation
    if not 0 <= chosen < len(trace):
        raise InputError(
            f"evaluation: found {chosen}, expected 0 to {len(trace) - 1}, those the search has made"
        )
    return chosen


def _heatmap(figure: go.Figure, trace: RoutingTrace, chosen: int) -> None:
    weights, scales = trace.weights[chosen], trace.scales[chosen]
    rows = [f"{block} (× {scale:.2f})" for block, scale in zip(trace.blocks, scales, strict=True)]
    figure.add_heatmap(
        x=list(trace.sources),
        y=rows,
        z=weights.tolist(),
        zmin=0,
        zmax=1,
        colorscale=share_scale(),
        showscale=False,
        xgap=2,
        ygap=2,
        name="routing weight",
        hovertemplate="%{y}<br>%{x}: weight %{z:.4f}<extra></extra>",
        row=1,
        col=1,
    )
    # A heatmap's own text has one colour; these numbers must be read on dark and on light.
    cells = [(e, b) for b in range(len(rows)) for e in range(len(trace.sources))]
    figure.add_scatter(
        x=[trace.sources[e] for e, _ in cells],
        y=[rows[b] for _, b in cells],
        text=[f"{weights[b, e]:.2f}" for e, b in cells],
        mode="text",
        textfont={"color": [text_on(colour_at(SHARE, share_position(weights[b, e]))) for e, b in cells]},
        hoverinfo="skip",
        showlegend=False,
        name="weight in figures",
        row=1,
        col=1,
    )


def _weights_over_time(figure: go.Figure, trace: RoutingTrace, row: int) -> None:
    for e, source in enumerate(trace.sources):
        values = trace.weights[:, row, e]
        _over_time(figure, trace, values, row + 1, 2, source, series_style(e), row == 0)


def _over_time(
    figure: go.Figure,
    trace: RoutingTrace,
    values: np.ndarray[Any, np.dtype[np.float64]],
    row: int,
    column: int,
    name: str,
    style: dict[str, str],
    legend: bool,
) -> None:
    """Candidates as dots, the value the best so far has as a line of steps; nothing before there is one."""
    drawn = trace.drawn().tolist()
    figure.add_scatter(
        x=drawn,
        y=values[drawn].tolist(),
        mode="markers",
        marker={"size": 4, "color": style["color"], "opacity": 0.5},
        name=name,
        legendgroup=name,
        showlegend=False,
        hovertemplate=f"evaluation %{{x}}: %{{y:.3f}}<extra>{name}</extra>",
        row=row,
        col=column,
    )
    led = [n for n in drawn if trace.incumbent[n] >= 0]
    figure.add_scatter(
        x=led,
        y=[float(values[trace.incumbent[n]]) for n in led],
        mode="lines",
        line={"shape": "hv", "width": 2, **style},
        name=name,
        legendgroup=name,
        showlegend=legend,
        hovertemplate=f"best so far at %{{x}}: %{{y:.3f}}<extra>{name}</extra>",
        row=row,
        col=column,
    )


def _named(trace: RoutingTrace, number: int) -> str:
    score = float(trace.score[number])
    result = score_text(trace.metric, score) if math.isfinite(score) else "failed"
    return f"left: evaluation {number}, {result}"
