"""What lies between two networks? Scores along straight lines, a panel a benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.interpolation import InterpolationCurve
from sfkit.analysis.labels import marked, metric_label, points
from sfkit.errors import InputError
from sfkit.figures.theme import LOOKS, finish, read_theme, series_style

MANY = 6
"""Lines that one panel can hold apart."""
ACROSS = 4


def interpolation_figure(
    curves: Sequence[InterpolationCurve],
    *,
    theme: str = "auto",
    ends: tuple[str, str] = ("base", "source"),
    height: int | None = None,
) -> go.Figure:
    """Draw scores along lines between networks; a dot marks the best of each.

    Args:
        curves: from :func:`~sfkit.analysis.interpolation.interpolation_curves`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        ends: what stands at 0 and at 1.
        height: of the figure in pixels; 460 unless given, by their number where each line has a panel.

    Raises:
        InputError: no curve, or an unknown theme.
    """
    if not curves:
        raise InputError("interpolation: found no curve, expected at least one to draw")
    benchmarks = list(dict.fromkeys(curve.benchmark for curve in curves))
    names = list(dict.fromkeys(curve.name for curve in curves))
    guided = {curve.benchmark for curve in curves if curve.validation}
    titles = [marked(escape(name), name in guided) for name in benchmarks]
    if len(benchmarks) == 1 and len(names) > MANY:
        return _apart(curves, theme=theme, ends=ends, height=height)
    figure = make_subplots(rows=1, cols=len(benchmarks), subplot_titles=titles, horizontal_spacing=0.07)
    for curve in curves:
        _line(figure, curve, names.index(curve.name), benchmarks.index(curve.benchmark) + 1)
    figure.update_xaxes(title_text=f"position (0 = {escape(ends[0])}, 1 = {escape(ends[1])})")
    metrics = {curve.benchmark: curve.metric for curve in curves}
    for col, name in enumerate(benchmarks, 1):
        # Neighbours of one metric share the title.
        if col == 1 or metrics[name] != metrics[benchmarks[col - 2]]:
            figure.update_yaxes(title_text=metric_label(metrics[name]), col=col)
    return finish(
        figure,
        theme=theme,
        title=f"What lies between {escape(ends[0])} and {escape(ends[1])}?",
        subtitle=_answer(curves, bool(guided)),
        height=height or 460,
        margin={"b": 130},
    )


def _apart(
    curves: Sequence[InterpolationCurve], *, theme: str, ends: tuple[str, str], height: int | None
) -> go.Figure:
    """Many lines on one benchmark: a panel each, all others faint behind it, on one scale."""
    across = min(ACROSS, len(curves))
    down = -(-len(curves) // across)
    figure = make_subplots(
        rows=down,
        cols=across,
        shared_xaxes=True,
        shared_yaxes=True,
        horizontal_spacing=0.02,
        vertical_spacing=0.09 if down > 1 else 0.0,
        subplot_titles=[escape(curve.name) for curve in curves],
    )
    faint = LOOKS[read_theme(theme)].rule
    for number, curve in enumerate(curves):
        place = {"row": number // across + 1, "col": number % across + 1}
        for other in curves:
            if other is not curve:
                # Behind it, so that each is read against all others on one scale.
                line = {"color": faint, "width": 1}
                hidden = {"mode": "lines", "hoverinfo": "skip", "showlegend": False}
                figure.add_scatter(
                    x=other.positions.tolist(),
                    y=other.scores.tolist(),
                    line=line,
                    **hidden,
                    **place,
                )
        _line(figure, curve, 0, place["col"], row=place["row"])
    figure.update_xaxes(tickvals=[0.0, 0.5, 1.0], ticktext=[escape(ends[0]), "half", escape(ends[1])])
    figure.update_yaxes(title_text=metric_label(curves[0].metric), col=1)
    first = curves[0]
    return finish(
        figure,
        theme=theme,
        title=f"What lies between {escape(ends[0])} and {escape(ends[1])}?",
        subtitle=f"{escape(marked(first.benchmark, first.validation))}: {_answer(curves, first.validation)}",
        height=height or 150 * down + 160,
        showlegend=False,
        margin={"b": 50},
    )


def _line(figure: go.Figure, curve: InterpolationCurve, number: int, col: int, *, row: int = 1) -> None:
    finite = np.isfinite(curve.scores)
    at, scores = curve.positions[finite], curve.scores[finite]
    best = scores.argmin() if scores.size else -1
    figure.add_scatter(
        x=at.tolist(),
        y=scores.tolist(),
        mode="lines+markers",
        line={**series_style(number), "width": 2},
        # Size 0 hides a dot and keeps what is said when one points at it.
        marker={"size": [9 if n == best else 0 for n in range(len(at))]},
        name=escape(curve.name),
        legendgroup=curve.name,
        showlegend=col == 1,
        hovertemplate="%{x:.2f}: %{y:.2f}<extra>" + escape(curve.name) + "</extra>",
        row=row,
        col=col,
    )


def _answer(curves: Sequence[InterpolationCurve], guided: bool) -> str:
    inside = sum(0.0 < curve.best < 1.0 for curve in curves)
    barriers = [curve.barrier for curve in curves if np.isfinite(curve.barrier)]
    unit = points(curves[0].unit)
    ridge = f"; the highest ridge stands {max(barriers):.2f} {unit} above its ends' line" if barriers else ""
    mark = "; * guided a search" if guided else ""
    return f"{inside} of {len(curves)} lines are best between their ends (dots){ridge}{mark}"
