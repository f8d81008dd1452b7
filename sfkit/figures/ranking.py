"""Does a score without labels rank networks as labels do? A panel a benchmark, a dot a network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.labels import metric_label, points
from sfkit.analysis.ranking import Ranking
from sfkit.errors import InputError
from sfkit.figures.theme import ACCENT, WARM, finish

BEST, PICK = "the best there is", "picked without labels"


def ranking_figure(
    rankings: Sequence[Ranking], *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw each network's true error over its score without labels.

    Args:
        rankings: from :func:`~sfkit.analysis.ranking.rank_networks`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; 420 unless given.

    Raises:
        InputError: no ranking, or an unknown theme.
    """
    if not rankings:
        raise InputError("ranking: found no benchmark, expected at least one to draw")
    titles = [f"{escape(one.benchmark)}: {one.agreement.correlation:.2f}" for one in rankings]
    figure = make_subplots(
        rows=1, cols=len(rankings), subplot_titles=titles, horizontal_spacing=0.2 / len(rankings)
    )
    for col, one in enumerate(rankings, 1):
        _dots(figure, one, col)
    figure.update_xaxes(title_text=metric_label("census"))
    figure.update_yaxes(title_text=rankings[0].metric.axis, col=1)
    return finish(
        figure,
        theme=theme,
        title="Does the score without labels rank networks as labels do?",
        subtitle=_answer(rankings),
        height=height or 420,
    )


def _dots(figure: go.Figure, one: Ranking, col: int) -> None:
    """All networks; on top of them the best as a ring, and the pick as a diamond."""
    every = list(range(len(one.networks)))
    # The later lies on top: the pick is seen where it is the best, too.
    marked = (
        (every, ACCENT, "circle", 6, "a network"),
        ([one.best], ACCENT, "circle-open", 15, BEST),
        ([one.picked], WARM, "diamond", 10, PICK),
    )
    for places, colour, symbol, size, name in marked:
        figure.add_scatter(
            x=one.census[places].tolist(),
            y=one.truth[places].tolist(),
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": size, "line": {"width": 2 * (size > 6)}},
            name=name,
            legendgroup=name,
            showlegend=col == 1,
            text=[escape(text) for text in np.array(one.networks)[places]],
            hovertemplate="%{text}<br>%{x:.2f} without, %{y:.2f} with labels<extra></extra>",
            row=1,
            col=col,
        )


def _answer(rankings: Sequence[Ranking]) -> str:
    found = [one.agreement.correlation for one in rankings]
    worst = max(rankings, key=lambda one: one.agreement.regret)
    by = f"by {worst.agreement.regret:.2f} {points(worst.metric.unit)}"
    if len(rankings) == 1:
        picks = f"misses the best {by}" if worst.agreement.regret else "picks the best"
        return f"rank correlation {found[0]:.2f}; it {picks}"
    hit = sum(one.agreement.regret == 0 for one in rankings)
    return (
        f"rank correlations {np.nanmin(found):.2f} to {np.nanmax(found):.2f}; it picks the best on {hit} of "
        f"{len(rankings)}, and misses it {by} at most"
    )
