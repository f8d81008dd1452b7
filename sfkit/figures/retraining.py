"""Retrain or merge? Error against what it takes when a new source's data come in."""

from __future__ import annotations

from html import escape

import plotly.graph_objects as go

from sfkit.analysis.retraining import Retraining
from sfkit.figures.theme import ACCENT, WARM, finish


def teaser_figure(record: Retraining, *, theme: str = "auto", height: int = 420) -> go.Figure:
    """Draw each way's mean error over its seconds; left and low is better (figure 1 of the paper).

    Args:
        record: from :func:`~sfkit.analysis.retraining.retraining_against_merging`; a way whose seconds are
            not known is left out.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels.

    Raises:
        InputError: an unknown theme.
    """
    figure = go.Figure()
    for name, joint, symbol, colour in (
        ("trained on all data", True, "square", WARM),
        ("merged", False, "circle", ACCENT),
    ):
        # NaN equals nothing: of such a way the seconds are not known.
        ways = [way for way in record.ways if way.joint is joint and way.seconds == way.seconds]
        figure.add_scatter(
            x=[way.seconds / 60.0 for way in ways],
            y=[way.score for way in ways],
            mode="markers+text",
            name=name,
            text=[escape(way.name) for way in ways],
            textposition="top center",
            marker={"symbol": symbol, "size": 13, "color": colour},
            customdata=[
                f"{way.cpu_seconds / 60.0:.1f}" if way.cpu_seconds == way.cpu_seconds else "unknown"
                for way in ways
            ],
            hovertemplate="%{text}: %{y:.2f} in %{x:.1f} minutes, %{customdata} of CPU<extra></extra>",
        )
    figure.update_xaxes(type="log", title_text="wall time once the new data are there (minutes, log)")
    figure.update_yaxes(title_text=f"mean error ({record.unit})")
    trained, *merged = record.ways
    best = min(merged, key=lambda way: way.score, default=trained)
    share = 100.0 * best.seconds / trained.seconds
    return finish(
        figure,
        theme=theme,
        title="Retrain on everything, or merge?",
        subtitle=f"{escape(best.name)} {best.score - trained.score:+.2f} against {escape(trained.name)}, "
        f"in {share:.1f} % of its wall time; mean over {escape(', '.join(record.benchmarks))}",
        height=height,
    )
