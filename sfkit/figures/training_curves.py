"""Has each training settled? Loss by step, and validation scores where some were taken."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.training_curves import WINDOW, TrainingCurve
from sfkit.errors import InputError
from sfkit.figures.theme import finish, series_style


def training_figure(
    curves: Sequence[TrainingCurve], *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw the smoothed loss of each training, beside its validation scores where it has some.

    Args:
        curves: from :func:`~sfkit.analysis.training_curves.training_curve`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; 420 unless given.

    Raises:
        InputError: no curve, or an unknown theme.
    """
    if not curves:
        raise InputError("training: found no curve, expected at least one to draw")
    scored = any(curve.scores for curve in curves)
    figure = make_subplots(rows=1, cols=1 + scored, horizontal_spacing=0.12)
    for number, curve in enumerate(curves):
        # One colour a training in both panels.
        line = {**series_style(number), "width": 2}
        name = escape(curve.name)
        loss = go.Scatter(
            x=curve.steps,
            y=curve.smoothed,
            mode="lines",
            line=line,
            name=name,
            legendgroup=name,
            hovertemplate="step %{x}: loss %{y:.3f}<extra>" + name + "</extra>",
        )
        figure.add_trace(loss, row=1, col=1)
        if curve.scores:
            score = go.Scatter(
                x=list(curve.scores),
                y=list(curve.scores.values()),
                mode="lines+markers",
                line=line,
                name=name,
                legendgroup=name,
                showlegend=False,
                hovertemplate="step %{x}: %{y:.2f}<extra>" + name + "</extra>",
            )
            figure.add_trace(score, row=1, col=2)
    figure.update_xaxes(title_text="training (steps)")
    figure.update_yaxes(title_text="training loss (px)", rangemode="tozero", col=1)
    if scored:
        figure.update_yaxes(title_text="validation score (its metric's unit)", col=2)
    return finish(
        figure,
        theme=theme,
        title="Has each training settled?",
        subtitle=f"mean loss of the last {WINDOW} steps; a line that still falls wants more of them",
        height=height or 420,
    )
