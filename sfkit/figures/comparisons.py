"""Which differences are more than noise? Methods against one reference, each with its interval."""

from __future__ import annotations

from html import escape

import plotly.graph_objects as go

from sfkit.analysis.comparisons import NetworkComparison
from sfkit.analysis.judgement import Judgement
from sfkit.analysis.labels import points
from sfkit.analysis.paired import Difference
from sfkit.figures.theme import ACCENT, LOOKS, WARM, finish, read_theme

ROW = 26
"""Height of one method's line in pixels."""


def comparison_figure(
    comparison: NetworkComparison, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw every row's difference to the reference on the unseen benchmarks, a whisker the interval.

    Args:
        comparison: from :func:`~sfkit.analysis.comparisons.compare_networks`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of rows unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = go.Figure()
    look = LOOKS[read_theme(theme)]
    found = [(row.network, row.difference) for row in comparison.rows if row.difference is not None]
    groups = (
        (Judgement.BETTER, "circle", ACCENT),
        (Judgement.WORSE, "circle", WARM),
        (Judgement.WITHIN_NOISE, "circle-open", look.muted),
        (Judgement.UNKNOWN, "x", look.muted),
    )
    for name, symbol, colour in groups:
        rows = [(network, d) for network, d in found if d.word is name and d.value == d.value]
        if not rows:
            continue
        intervals = [d.interval or (d.value, d.value) for _, d in rows]
        figure.add_trace(
            go.Scatter(
                x=[d.value for _, d in rows],
                y=[escape(network) for network, _ in rows],
                mode="markers",
                name=name,
                marker={"symbol": symbol, "size": 10, "color": colour, "line": {"width": 2, "color": colour}},
                error_x={
                    "type": "data",
                    "symmetric": False,
                    "array": [high - d.value for (_, d), (_, high) in zip(rows, intervals, strict=True)],
                    "arrayminus": [d.value - low for (_, d), (low, _) in zip(rows, intervals, strict=True)],
                    "color": colour,
                    "thickness": 2,
                },
                hovertemplate="%{y}: %{x:+.2f} " + comparison.unit + f"<extra>{name}</extra>",
            )
        )
    figure.add_vline(x=0.0, line={"color": look.muted, "dash": "dot", "width": 1}, layer="below")
    order = [escape(network) for network, _ in found]
    figure.update_yaxes(
        type="category",
        categoryorder="array",
        categoryarray=order,
        autorange="reversed",
        title_text="network",
    )
    unit = points(comparison.unit, full=True)
    figure.update_xaxes(title_text=f"difference to {escape(comparison.reference)} ({unit})")
    return finish(
        figure,
        theme=theme,
        title=f"Which networks differ from {escape(comparison.reference)} by more than noise?",
        subtitle=_answer([d for _, d in found]),
        height=height or ROW * len(found) + 220,
    )


def _answer(found: list[Difference]) -> str:
    told = (Judgement.BETTER, Judgement.WORSE, Judgement.WITHIN_NOISE)
    counts = {str(name): sum(d.word is name for d in found) for name in told}
    level = f"{100 * found[0].level:.0f} %" if found else "95 %"
    said = ", ".join(f"{number} {name}" for name, number in counts.items() if number) or "none can be told"
    return f"{said}; further left is better; whiskers: {level} intervals over images"
