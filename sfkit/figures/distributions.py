"""Stage 2: is it still moving? Score, and where it looks: CMA-ES's distribution, a model's trust region."""

from __future__ import annotations

import math
from collections.abc import Mapping

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.labels import metric_label, score_text
from sfkit.analysis.routings import RoutingTrace
from sfkit.figures.axes import FAILED_NAME, beyond, log_ticks
from sfkit.figures.theme import ACCENT, FAILED, LOOKS, WARM, finish, read_theme


def cmaes_figure(trace: RoutingTrace, *, theme: str = "auto", height: int = 620) -> go.Figure:
    """Draw scores, step size and axis lengths over the evaluations of a Stage 2 search.

    Of a search by a model it draws scores and the radius of its trust region.

    Args:
        trace: from :func:`~sfkit.analysis.routings.routing_trace`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    panels = [
        ("trust region's radius (in x)" if trace.by_model else "step size σ (in x)", trace.sigma),
        *([] if trace.by_model else [("axis lengths (in x)", trace.axes)]),
    ]
    rows = 1 + len(panels)
    # Scores get the most room: they are what one looks for.
    heights = [3, 2, 2][:rows]
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=heights)
    _scores(figure, trace)
    _step_size(figure, trace)
    if not trace.by_model:
        _axis_lengths(figure, trace, LOOKS[read_theme(theme)].muted)
    figure.update_yaxes(title_text=metric_label(trace.metric), row=1, col=1)
    for row, (title, values) in enumerate(panels, start=2):
        ticks = log_ticks(values.ravel().tolist())
        labels = [f"{tick:.3g}" for tick in ticks]
        figure.update_yaxes(title_text=title, type="log", tickvals=ticks, ticktext=labels, row=row, col=1)
    figure.update_xaxes(title_text="evaluation (number)", row=rows, col=1)
    return finish(
        figure,
        theme=theme,
        title="Is Stage 2 still improving, and still searching?",
        subtitle=_answer(trace),
        height=height,
    )


def _scores(figure: go.Figure, trace: RoutingTrace) -> None:
    drawn = trace.drawn().tolist()
    scored = [n for n in drawn if math.isfinite(trace.score[n])]
    # They are drawn above all others, so that nobody reads them as scores.
    failed = [n for n in drawn if not math.isfinite(trace.score[n])]
    led = [n for n in drawn if trace.incumbent[n] >= 0]
    dots = {"size": 5, "color": WARM, "opacity": 0.5}
    _add(figure, 1, scored, [float(trace.score[n]) for n in scored], "candidate", "markers", marker=dots)
    best = [float(trace.score[trace.incumbent[n]]) for n in led]
    _add(figure, 1, led, best, "best so far", "lines", line={"color": ACCENT, "width": 2, "shape": "hv"})
    if failed:
        edge = beyond(float(trace.score[n]) for n in scored)
        mark = {"size": 8, "color": FAILED, "symbol": "x"}
        _add(figure, 1, failed, [edge] * len(failed), FAILED_NAME, "markers", marker=mark)
        figure.data[-1].hovertemplate = f"evaluation %{{x}}<extra>{FAILED_NAME}</extra>"


def _step_size(figure: go.Figure, trace: RoutingTrace) -> None:
    first = trace.iterations().tolist()
    sigma = [float(trace.sigma[n]) for n in first]
    _add(
        figure,
        2,
        first,
        sigma,
        "radius" if trace.by_model else "step size σ",
        "lines",
        line={"color": ACCENT, "width": 2, "shape": "hv"},
        legend=False,
    )


def _axis_lengths(figure: go.Figure, trace: RoutingTrace, muted: str) -> None:
    """One line an axis; the longest and the shortest stand out, since their ratio is the conditioning."""
    first, last = trace.iterations().tolist(), trace.axes.shape[1] - 1
    for axis in range(last + 1):
        end = {0: "shortest axis", last: "longest axis"}.get(axis)
        line = {"color": ACCENT if end else muted, "width": 2 if end else 1, "shape": "hv"}
        name = end or f"axis {axis + 1}"
        _add(figure, 3, first, trace.axes[first, axis].tolist(), name, "lines", line=line, legend=False)


def _add(
    figure: go.Figure,
    row: int,
    x: list[int],
    y: list[float],
    name: str,
    mode: str,
    *,
    line: Mapping[str, object] | None = None,
    marker: Mapping[str, object] | None = None,
    legend: bool = True,
) -> None:
    figure.add_scatter(
        x=x,
        y=y,
        mode=mode,
        line=line,
        marker=marker,
        name=name,
        showlegend=legend,
        hovertemplate=f"evaluation %{{x}}: %{{y:.4g}}<extra>{name}</extra>",
        row=row,
        col=1,
    )


def _answer(trace: RoutingTrace) -> str:
    if trace.best < 0:
        return f"none of {len(trace)} evaluations has a score"
    best = score_text(trace.metric, float(trace.score[trace.best]))
    first = float(trace.score[0])
    gain = (
        f", {first - float(trace.score[trace.best]):.2f} below equal weights" if math.isfinite(first) else ""
    )
    return f"best: evaluation {trace.best} of {len(trace)}, {best}{gain}"
