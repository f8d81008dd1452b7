"""A search by a model: what did the model foretell, what came, and may one believe its intervals?"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.labels import metric_label
from sfkit.analysis.predictions import PredictionCalibration, Predictions
from sfkit.errors import InputError
from sfkit.figures.axes import FAILED_NAME, beyond
from sfkit.figures.theme import ACCENT, FAILED, LOOKS, WARM, finish, read_theme

BAND, HONEST = "rgba(43,123,211,0.22)", "rgba(128,128,128,0.18)"
Array = NDArray[np.float64]
WITHIN = 1.96
"""Standard deviations to either side that hold 95 of 100 values of a normal distribution."""


def predictions_figure(told: Predictions, *, theme: str = "auto", height: int = 560) -> go.Figure:
    """Draw what the model foretold of its proposals beside what came, and what it chose them by.

    Args:
        told: from :func:`~sfkit.analysis.predictions.predictions`, with at least one proposal.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels.

    Raises:
        InputError: no proposal, or an unknown theme.
    """
    if not len(told):
        raise InputError(
            "predictions: found no proposal of a model, expected at least one: search with "
            "BayesianSubsetSearch or BayesianRoutingSearch (--method bayesian)"
        )
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07, row_heights=[3, 2])
    drawn = drawn_points(len(told))
    numbers = told.number[drawn].tolist()
    mean, sd = told.mean[drawn], told.sd[drawn]
    _band(figure, 1, numbers, mean - WITHIN * sd, mean + WITHIN * sd, "95 % interval", BAND)
    _line(figure, 1, numbers, mean.tolist(), "predicted", {"color": ACCENT, "width": 2}, sd.tolist())
    _measured(figure, told, drawn.tolist())
    bound = told.bound[drawn].tolist()
    _line(figure, 2, numbers, bound, "bound it was chosen by", {"color": ACCENT, "width": 2})
    # None breaks the line: before the first score there is no best.
    best = [value if math.isfinite(value) else None for value in told.best[drawn].tolist()]
    line = {"color": WARM, "width": 2, "dash": "dash", "shape": "hv"}
    _line(figure, 2, numbers, best, "best before", line)
    figure.update_yaxes(title_text=metric_label(told.metric))
    figure.update_xaxes(title_text="candidate (number)", row=2, col=1)
    return finish(
        figure,
        theme=theme,
        title="What did the model expect of its proposals, and what came?",
        subtitle="band: ± 1.96 standard deviations; where the bound meets the best, no gain is expected",
        height=height,
    )


def calibration_figure(found: PredictionCalibration, *, theme: str = "auto", height: int = 460) -> go.Figure:
    """Draw measured over predicted scores, and how many measured scores the intervals hold.

    Args:
        found: from :func:`~sfkit.analysis.predictions.calibration`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    muted = LOOKS[read_theme(theme)].muted
    figure = make_subplots(rows=1, cols=2, column_widths=[0.58, 0.42], horizontal_spacing=0.14)
    _against(figure, found, muted)
    _coverage(figure, found, muted)
    label = metric_label(found.metric)
    figure.update_xaxes(title_text=f"predicted {label}", row=1, col=1)
    figure.update_yaxes(title_text=f"measured {label}", row=1, col=1)
    figure.update_xaxes(title_text="level of the interval (%)", range=[0, 102], row=1, col=2)
    figure.update_yaxes(title_text="measured inside (% of proposals)", range=[-3, 103], row=1, col=2)
    return finish(
        figure,
        theme=theme,
        title="May one believe the model?",
        subtitle=_answer(found),
        height=height,
    )


def _band(
    figure: go.Figure, col: int, x: Sequence[float], low: Array, high: Array, name: str, colour: str
) -> None:
    figure.add_scatter(
        # Along the upper edge and back along the lower one: a closed band.
        x=[*x, *reversed(x)],
        y=[*high.tolist(), *low[::-1].tolist()],
        mode="lines",
        line={"width": 0},
        fill="toself",
        fillcolor=colour,
        name=name,
        hoverinfo="skip",
        row=1,
        col=col,
    )


def _line(
    figure: go.Figure,
    row: int,
    x: list[int],
    y: Sequence[float | None],
    name: str,
    line: dict[str, object],
    spread: list[float] | None = None,
) -> None:
    more = " ± %{customdata:.3g}" if spread else ""
    figure.add_scatter(
        x=x,
        y=list(y),
        # A single point makes no line.
        mode="lines" if len(x) > 1 else "lines+markers",
        line=line,
        name=name,
        customdata=spread,
        hovertemplate=f"candidate %{{x}}: %{{y:.4g}}{more}<extra>{name}</extra>",
        row=row,
        col=1,
    )


def _measured(figure: go.Figure, told: Predictions, drawn: list[int]) -> None:
    scored = [n for n in drawn if told.measured[n]]
    failed = [n for n in drawn if not told.measured[n]]
    # Past the predictions, which share the axis.
    edge = beyond([*(float(told.score[n]) for n in scored), *told.mean.tolist()])
    for group, values, name, marker in (
        (scored, [float(told.score[n]) for n in scored], "measured", {"size": 6, "color": WARM}),
        (failed, [edge] * len(failed), FAILED_NAME, {"size": 8, "color": FAILED, "symbol": "x"}),
    ):
        if group:
            figure.add_scatter(
                x=told.number[group].tolist(),
                y=values,
                mode="markers",
                marker=marker,
                name=name,
                hovertemplate=(
                    f"candidate %{{x}}<extra>{name}</extra>"
                    if name == FAILED_NAME
                    else f"candidate %{{x}}: %{{y:.4g}}<extra>{name}</extra>"
                ),
                row=1,
                col=1,
            )


def _against(figure: go.Figure, found: PredictionCalibration, muted: str) -> None:
    ends = [
        float(min((found.mean - found.sd).min(), found.score.min())),
        float(max((found.mean + found.sd).max(), found.score.max())),
    ]
    figure.add_scatter(
        x=ends,
        y=ends,
        mode="lines",
        line={"color": muted, "dash": "dash", "width": 1},
        name="as predicted",
        hoverinfo="skip",
        row=1,
        col=1,
    )
    figure.add_scatter(
        x=found.mean.tolist(),
        y=found.score.tolist(),
        error_x={"array": found.sd.tolist(), "color": muted, "thickness": 1, "width": 2},
        mode="markers",
        marker={"size": 6, "color": ACCENT},
        name="proposal, ± 1 standard deviation",
        customdata=np.stack([found.number, found.sd], axis=1).tolist(),
        hovertemplate="candidate %{customdata[0]:.0f}<br>predicted %{x:.4g} ± %{customdata[1]:.3g}<br>"
        "measured %{y:.4g}<extra></extra>",
        row=1,
        col=1,
    )


def _coverage(figure: go.Figure, found: PredictionCalibration, muted: str) -> None:
    levels = [100.0 * level for level in found.levels]
    low, high = 100.0 * np.array(found.honest).T
    _band(figure, 2, levels, low, high, "where an honest model's would be", HONEST)
    for x, y, name, mode, style in (
        ([0.0, 100.0], [0.0, 100.0], "as many as promised", "lines", {"color": muted, "dash": "dash"}),
        (levels, [100.0 * c for c in found.coverage], "inside", "lines+markers", {"color": ACCENT}),
    ):
        figure.add_scatter(
            x=x,
            y=y,
            mode=mode,
            line={"width": 2 if name == "inside" else 1, **style},
            name=name,
            showlegend=name == "inside",
            hovertemplate=f"%{{x:.0f}} % interval: %{{y:.0f}} % {name}<extra></extra>",
            row=1,
            col=2,
        )


def _answer(found: PredictionCalibration) -> str:
    # That next to 95 %.
    level = max(range(len(found.levels)), key=lambda n: -abs(found.levels[n] - 0.95))
    (low, high), covered = found.honest[level], found.coverage[level]
    word = "too bold" if covered < low else "too careful" if covered > high else "as promised"
    failed = f"; {found.failed} failed" if found.failed else ""
    return (
        f"{len(found.score)} proposals, {100 * covered:.0f} % inside the {100 * found.levels[level]:.0f} % "
        f"interval ({word}); measured - predicted {found.error:+.2g} at the mean, {found.rms:.2g} root mean "
        f"square{failed}"
    )
