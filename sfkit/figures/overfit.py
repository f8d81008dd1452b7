"""Does Stage 2 help on pairs it never saw? Change of the unseen score along pairs or evaluations."""

from __future__ import annotations

import math

import plotly.graph_objects as go

from sfkit.analysis.labels import metric_label
from sfkit.analysis.overfit import LearningCurve
from sfkit.figures.theme import LOOKS, SERIES, finish, read_theme

TITLES = {
    "pairs": ("How many validation pairs does Stage 2 need?", "validation pairs (number)"),
    "evaluations": ("When does Stage 2 stop helping unseen pairs?", "evaluations of Stage 2 (number)"),
}


def learning_figure(curve: LearningCurve, *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw the change on unseen pairs, whiskers over runs, and on the validation pairs dotted beside it.

    Args:
        curve: from :func:`~sfkit.analysis.overfit.learning_curve`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; 440 unless given.

    Raises:
        InputError: an unknown theme.
    """
    muted = LOOKS[read_theme(theme)].muted
    title, place = TITLES[curve.along]
    figure = go.Figure()
    for row, name in enumerate(curve.trials):
        colour = SERIES[row % len(SERIES)]
        for values, kind, dash in (
            (curve.unseen[row], "unseen", "solid"),
            (curve.validation[row], "validation", "dot"),
        ):
            drawn = [k for k, value in enumerate(values) if math.isfinite(value)]
            whiskers = None
            if kind == "unseen":
                whiskers = {
                    "array": [float(curve.highest[row, k] - values[k]) for k in drawn],
                    "arrayminus": [float(values[k] - curve.lowest[row, k]) for k in drawn],
                    "thickness": 1,
                    "width": 3,
                }
            if drawn:
                figure.add_scatter(
                    x=[curve.places[k] for k in drawn],
                    y=[float(values[k]) for k in drawn],
                    error_y=whiskers,
                    mode="lines+markers",
                    line={"color": colour, "width": 2 if kind == "unseen" else 1, "dash": dash},
                    marker={"size": 6 if kind == "unseen" else 4},
                    name=f"{name}, {kind}",
                    legendgroup=name,
                    hovertemplate=f"%{{x}}: %{{y:+.2f}}<extra>{name}, {kind}</extra>",
                )
    figure.add_hline(y=0.0, line={"color": muted, "width": 1, "dash": "dot"}, layer="below")
    figure.update_xaxes(title_text=place)
    figure.update_yaxes(title_text=f"change of {metric_label(curve.metric)}")
    return finish(figure, theme=theme, title=title, subtitle=_answer(curve), height=height or 440)


def _answer(curve: LearningCurve) -> str:
    better = [
        name
        for name, row in zip(curve.trials, curve.unseen, strict=True)
        if any(math.isfinite(v) for v in row) and all(v < 0 for v in row if math.isfinite(v))
    ]
    named = ", ".join(better) if better else "none"
    most = int(curve.runs.max(initial=0))
    runs = f"{most} run{'s' * (most != 1)}"
    return f"below 0 is better than Stage 1; always so on unseen pairs: {named} (up to {runs} a point)"
