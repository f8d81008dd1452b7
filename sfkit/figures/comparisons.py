"""Which differences are more than noise, and where? Networks against one reference, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.comparisons import ComparedNetwork, NetworkComparison
from sfkit.analysis.labels import Judgement, marked, points
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
        # NaN equals nothing: a network that failed gets no dot.
        rows = [(network, d) for network, d in found if d.word is name and d.value == d.value]
        if not rows:
            continue
        intervals = [d.interval or (d.value, d.value) for _, d in rows]
        figure.add_scatter(
            x=[d.value for _, d in rows],
            y=[escape(network) for network, _ in rows],
            mode="markers",
            name=name,
            marker={"symbol": symbol, "size": 10, "color": colour, "line": {"width": 2, "color": colour}},
            error_x={
                "type": "data",
                "symmetric": False,
                # Lengths, as plotly wants them, not ends.
                "array": [high - d.value for (_, d), (_, high) in zip(rows, intervals, strict=True)],
                "arrayminus": [d.value - low for (_, d), (low, _) in zip(rows, intervals, strict=True)],
                "color": colour,
                "thickness": 2,
            },
            hovertemplate="%{y}: %{x:+.2f} " + comparison.unit + f"<extra>{name}</extra>",
        )
    figure.add_vline(x=0.0, line={"color": look.muted, "dash": "dot", "width": 1}, layer="below")
    # In the table's order, whichever group draws first.
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
    judged = ", ".join(f"{number} {name}" for name, number in counts.items() if number) or "none can be told"
    return f"{judged}; further left is better; whiskers: {level} interval of each alone"


PANEL_ROW = 22
"""Height of one network's line in pixels."""

PANELS_A_ROW = 3
COLOURS = {Judgement.BETTER: ACCENT, Judgement.WORSE: WARM}
SYMBOLS = {Judgement.UNKNOWN: "x-thin", Judgement.WITHIN_NOISE: "circle-open"}


def benchmark_comparison_figure(
    comparison: NetworkComparison, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw each network's difference to the reference with its interval, a panel a benchmark.

    The first panel is the mean over the benchmarks that guided no search, where there are several.

    Args:
        comparison: from :func:`~sfkit.analysis.comparisons.compare_networks`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of networks and benchmarks unless given.

    Raises:
        InputError: an unknown theme.
    """
    rows = [row for row in comparison.rows if row.network != comparison.reference]
    panels = _panels(comparison, rows)
    across = min(PANELS_A_ROW, len(panels))
    down = -(-len(panels) // across)
    each = PANEL_ROW * max(len(rows), 2) + 60
    figure = make_subplots(
        rows=down,
        cols=across,
        shared_yaxes=True,
        horizontal_spacing=0.03,
        # 60 px hold a panel's title, and the ticks of the one above.
        vertical_spacing=min(0.28, 60 / (each * down)) if down > 1 else 0.0,
        subplot_titles=[title for title, _ in panels],
    )
    muted = LOOKS[read_theme(theme)].muted
    for number, (_, differences) in enumerate(panels):
        row, col = divmod(number, across)
        _panel(figure, differences, muted, row + 1, col + 1)
    names = [row.network for row in rows]
    figure.update_yaxes(type="category", categoryorder="array", categoryarray=names, autorange="reversed")
    figure.update_yaxes(title_text="network", col=1)
    unit = points(comparison.unit, full=True)
    for number in range(max(0, len(panels) - across), len(panels)):  # the lowest panel of each column
        row, col = divmod(number, across)
        figure.update_xaxes(title_text=f"difference ({unit})", row=row + 1, col=col + 1)
    return finish(
        figure,
        theme=theme,
        title=f"Where is which network better than {escape(comparison.reference)}, beyond noise?",
        subtitle=_answer_by_benchmark(rows, comparison),
        height=height or each * down + 110,
        showlegend=False,
        margin={"b": 50},
    )


def _panels(
    comparison: NetworkComparison, rows: Sequence[ComparedNetwork]
) -> list[tuple[str, list[Difference]]]:
    panels = []
    if sum(not column.validation for column in comparison.columns) > 1:
        panels.append(("mean of the unseen", [r.unseen_difference for r in rows if r.unseen_difference]))
    for number, column in enumerate(comparison.columns):
        title = f"{marked(escape(column.benchmark), column.validation)}, {column.metric}"
        panels.append((title, [row.differences[number] for row in rows]))
    return panels


def _panel(figure: go.Figure, differences: Sequence[Difference], muted: str, row: int, col: int) -> None:
    drawn = [d for d in differences if math.isfinite(d.value)]
    ends = [d.interval or (d.value, d.value) for d in drawn]
    colours = [COLOURS.get(d.word, muted) for d in drawn]
    # Lines before dots: what comes later is drawn on top.
    for difference, (low, high), colour in zip(drawn, ends, colours, strict=True):
        figure.add_scatter(
            x=[low, high],
            y=[difference.network] * 2,
            mode="lines",
            line={"color": colour, "width": 3},
            hoverinfo="skip",
            name="interval",
            row=row,
            col=col,
        )
    figure.add_scatter(
        x=[d.value for d in drawn],
        y=[d.network for d in drawn],
        mode="markers",
        marker={
            "size": 9,
            "symbol": [SYMBOLS.get(d.word, "circle") for d in drawn],
            "color": colours,
            "line": {"width": 2, "color": colours},
        },
        text=[escape(str(d)) for d in drawn],
        hovertemplate="%{y}: %{text}<extra></extra>",
        name="difference",
        row=row,
        col=col,
    )
    reach = [end for pair in ends for end in pair]
    # 0 is what one compares with, and always in sight.
    low, high = min([0.0, *reach]), max([0.0, *reach])
    # Where all stand at 0 any width will do.
    margin = 0.06 * (high - low) or 1.0
    figure.update_xaxes(range=[low - margin, high + margin], row=row, col=col)
    figure.add_vline(x=0.0, line={"color": muted, "width": 1}, layer="below", row=row, col=col)


def _answer_by_benchmark(rows: Sequence[ComparedNetwork], comparison: NetworkComparison) -> str:
    better = sum(row.difference is not None and row.difference.word is Judgement.BETTER for row in rows)
    guided = "; * guided a search" if any(column.validation for column in comparison.columns) else ""
    return (
        f"left is better; {better} of {len(rows)} are, corrected together; whiskers: 95 % interval of "
        f"each alone; open: within noise, ×: no interval{guided}"
    )
