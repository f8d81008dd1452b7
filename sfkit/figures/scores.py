"""Which network is better where? Networks by benchmark, as dots on one scale a panel."""

from __future__ import annotations

from html import escape

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.labels import marked, metric_label
from sfkit.analysis.scores import ScoreColumn, ScoreGrid
from sfkit.figures.axes import FAILED_NAME, beyond
from sfkit.figures.theme import ACCENT, FAILED, LOOKS, WARM, finish, read_theme

ROW = 20
"""Height of one network's line in pixels."""


def scores_figure(
    grid: ScoreGrid, *, theme: str = "auto", reference: str | None = "base", height: int | None = None
) -> go.Figure:
    """Draw scores as dots: networks in rows, benchmarks in columns, metrics one below the other.

    Where each benchmark has one metric, its own, all panels stand side by side.

    Args:
        grid: from :func:`~sfkit.analysis.scores.score_grid`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        reference: the network whose score is a line through each panel; None draws none.
        height: of the figure in pixels; by the number of networks and metrics unless given.

    Raises:
        InputError: an unknown theme.
    """
    benchmarks, metrics = grid.benchmarks, grid.metrics
    rows = 1 if len(grid.columns) == len(benchmarks) else len(metrics)
    figure = make_subplots(
        rows=rows,
        cols=len(benchmarks),
        shared_yaxes=True,
        # All gaps together take at most 30 % of the width.
        horizontal_spacing=min(0.03, 0.3 / len(benchmarks)),
        vertical_spacing=0.3 / rows if rows > 1 else 0.0,
        # Lower rows go without a title: their axes name the metric.
        subplot_titles=[_panel_title(grid, name) for name in benchmarks] + [""] * len(benchmarks),
    )
    for number, column in enumerate(grid.columns):
        row = metrics.index(column.metric) + 1 if rows > 1 else 1
        col = benchmarks.index(column.benchmark) + 1
        _panel(figure, grid, number, row, col, theme, reference)
    figure.update_yaxes(
        type="category", categoryorder="array", categoryarray=list(grid.networks), autorange="reversed"
    )
    figure.update_yaxes(title_text="network", col=1)
    marked = any(column.validation for column in grid.columns)
    guided = "; * guided the search, so it is no test" if marked else ""
    return finish(
        figure,
        theme=theme,
        title="Which network is better where?",
        subtitle=f"further left is better; filled: the best of each panel{guided}",
        height=height or rows * (ROW * len(grid.networks) + 80) + 130,
        showlegend=False,
        margin={"b": 50},
    )


def _panel_title(grid: ScoreGrid, benchmark: str) -> str:
    guided = any(column.validation for column in grid.columns if column.benchmark == benchmark)
    return marked(escape(benchmark), guided)


def _panel(
    figure: go.Figure, grid: ScoreGrid, number: int, row: int, col: int, theme: str, reference: str | None
) -> None:
    column, values = grid.columns[number], grid.values[:, number]
    finite = np.flatnonzero(np.isfinite(values))
    _dots(figure, grid, column, values, finite, row, col)
    figure.update_xaxes(title_text=metric_label(column.metric), row=row, col=col)
    missing = [n for n in range(len(values)) if not np.isfinite(values[n])]
    if missing:
        # A network that failed has no place on the scale.
        edge = beyond(values.tolist())
        figure.add_scatter(
            x=[edge] * len(missing),
            y=[grid.networks[n] for n in missing],
            mode="markers",
            marker={"symbol": "x", "size": 9, "color": FAILED},
            name=FAILED_NAME,
            hovertemplate=f"%{{y}}<extra>{FAILED_NAME}</extra>",
            row=row,
            col=col,
        )
    if reference in grid.networks and np.isfinite(held := values[grid.networks.index(reference)]):
        line = {"color": LOOKS[read_theme(theme)].muted, "dash": "dot", "width": 1}
        figure.add_vline(x=float(held), line=line, layer="below", row=row, col=col)


def _dots(
    figure: go.Figure,
    grid: ScoreGrid,
    column: ScoreColumn,
    values: np.ndarray[tuple[int], np.dtype[np.float64]],
    finite: np.ndarray[tuple[int], np.dtype[np.intp]],
    row: int,
    col: int,
) -> None:
    if not len(finite):
        return
    best = values[finite].min()
    # Equal scores are all the best.
    colours = [WARM if values[n] == best else ACCENT for n in finite]
    figure.add_scatter(
        x=values[finite].tolist(),
        y=[grid.networks[n] for n in finite],
        mode="markers",
        marker={
            "size": 9,
            "symbol": ["circle" if values[n] == best else "circle-open" for n in finite],
            "color": colours,
            "line": {"width": 2, "color": colours},
        },
        name=f"{escape(column.benchmark)} {column.metric}",
        hovertemplate=f"%{{y}}: %{{x:.2f}} {column.unit}<extra></extra>",
        row=row,
        col=col,
    )
