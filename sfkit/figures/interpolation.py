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
from sfkit.figures.theme import finish, read_theme, series_style


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
        height: of the figure in pixels; 460 unless given.

    Raises:
        InputError: no curve, or an unknown theme.
    """
    read_theme(theme)
    if not curves:
        raise InputError("interpolation: found no curve, expected at least one to draw")
    benchmarks = list(dict.fromkeys(curve.benchmark for curve in curves))
    names = list(dict.fromkeys(curve.name for curve in curves))
    guided = {curve.benchmark for curve in curves if curve.validation}
    titles = [marked(escape(name), name in guided) for name in benchmarks]
    figure = make_subplots(rows=1, cols=len(benchmarks), subplot_titles=titles, horizontal_spacing=0.07)
    for curve in curves:
        _line(figure, curve, names.index(curve.name), benchmarks.index(curve.benchmark) + 1)
    figure.update_xaxes(title_text=f"position (0 = {escape(ends[0])}, 1 = {escape(ends[1])})")
    figure.update_yaxes(title_text=metric_label(curves[0].metric), col=1)
    figure.update_annotations(font_size=12)
    return finish(
        figure,
        theme=theme,
        title=f"What lies between {escape(ends[0])} and {escape(ends[1])}?",
        subtitle=_answer(curves, bool(guided)),
        height=height or 460,
        margin={"b": 130},
    )


def _line(figure: go.Figure, curve: InterpolationCurve, number: int, col: int) -> None:
    finite = np.isfinite(curve.scores)
    at, scores = curve.positions[finite], curve.scores[finite]
    best = scores.argmin() if scores.size else -1
    figure.add_trace(
        go.Scatter(
            x=at.tolist(),
            y=scores.tolist(),
            mode="lines+markers",
            line={**series_style(number), "width": 2},
            marker={"size": [9 if n == best else 0 for n in range(len(at))]},
            name=escape(curve.name),
            legendgroup=curve.name,
            showlegend=col == 1,
            hovertemplate="%{x:.2f}: %{y:.2f}<extra>" + escape(curve.name) + "</extra>",
        ),
        row=1,
        col=col,
    )


def _answer(curves: Sequence[InterpolationCurve], guided: bool) -> str:
    inside = sum(0.0 < curve.best < 1.0 for curve in curves)
    barriers = [curve.barrier for curve in curves if np.isfinite(curve.barrier)]
    unit = points(curves[0].unit)
    ridge = f"; the highest ridge stands {max(barriers):.2f} {unit} above its ends' line" if barriers else ""
    mark = "; * guided a search" if guided else ""
    return f"{inside} of {len(curves)} lines are best between their ends (dots){ridge}{mark}"
