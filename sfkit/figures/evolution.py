"""Stage 1: which sources does the population settle on, and how alike do its subsets become?

In the population figure two rows share their columns: the sources on the left, the score on the right. Above
stand the generations, time running down, and below them the individuals of one generation, best first. So a
source is followed down one column, from how often it was chosen over time to who has it now.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.evolution import Evolution, Individual, PopulationHistory
from sfkit.analysis.labels import metric_label, score_text
from sfkit.figures.axes import FAILED_NAME, beyond, whole_ticks
from sfkit.figures.theme import ACCENT, FAILED, LOOKS, WARM, finish, read_theme

MIN_PANEL, SPACING = 150, 0.04
"""Least height of a row of panels in pixels, and the part of the height between the two."""


def population_figure(
    history: PopulationHistory, *, theme: str = "auto", individuals: int = 60, height: int | None = None
) -> go.Figure:
    """Draw a population and how it came about.

    Args:
        history: from :func:`~sfkit.analysis.evolution.population_history`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        individuals: how many of the generation to list, best first; the subtitle says where some are not.
        height: of the figure in pixels; by the number of rows unless given.

    Raises:
        InputError: an unknown theme.
    """
    shown = history.individuals[:individuals]
    upper = max(MIN_PANEL, 18 * min(history.generations, 20))
    lower = max(MIN_PANEL, 12 * len(shown))
    figure = make_subplots(
        rows=2,
        cols=2,
        column_widths=[0.62, 0.38],
        # In pixels: plotly takes them as shares of their sum.
        row_heights=[upper, lower],
        horizontal_spacing=0.03,
        vertical_spacing=SPACING,
        shared_xaxes=True,
        shared_yaxes=True,
    )
    _share_over_time(figure, history, upper / (upper + lower))
    _score_over_time(figure, history)
    _membership(figure, history, shown, theme)
    _scores(figure, history, shown)
    _axes(figure, history, len(shown))
    return finish(
        figure,
        theme=theme,
        title="Which sources does the population settle on?",
        subtitle=_answer(history, len(shown)),
        height=height or round((upper + lower) / (1.0 - SPACING)) + 180,
    )


def _share_over_time(figure: go.Figure, history: PopulationHistory, part: float) -> None:
    rows = drawn_points(history.generations).tolist()
    figure.add_heatmap(
        x=list(history.sources),
        y=rows,
        z=[[100.0 * share for share in history.share[row]] for row in rows],
        zmin=0,
        zmax=100,
        colorscale=[[0, "rgba(43,123,211,0.08)"], [1, ACCENT]],
        xgap=2,
        ygap=1,
        colorbar={
            "title": {"text": "have the source (%)", "side": "right"},
            "thickness": 12,
            "len": part,
            "y": 1.0,
            "yanchor": "top",
            "outlinewidth": 0,
        },
        name="share",
        hovertemplate="generation %{y}<br>%{x}: %{z:.0f} % of the individuals<extra></extra>",
        row=1,
        col=1,
    )


def _score_over_time(figure: go.Figure, history: PopulationHistory) -> None:
    lines = (
        ("best so far", history.best, {"color": ACCENT, "width": 2}),
        ("median of the population", history.median, {"color": WARM, "width": 2, "dash": "dash"}),
    )
    for name, scores, line in lines:
        rows = [row for row in drawn_points(len(scores)).tolist() if math.isfinite(scores[row])]
        figure.add_scatter(
            x=[scores[row] for row in rows],
            y=rows,
            mode="lines+markers",
            marker={"size": 5, "color": line["color"]},
            line=line,
            name=name,
            hovertemplate="generation %{y}: %{x:.3f}<extra>" + name + "</extra>",
            row=1,
            col=2,
        )


def _membership(
    figure: go.Figure, history: PopulationHistory, shown: Sequence[Individual], theme: str
) -> None:
    texts = [_described(one, history.metric) for one in shown]
    _marks(figure, history.sources, shown, texts, theme, name="membership", ygap=1, row=2, col=1)


def _marks(
    figure: go.Figure,
    sources: Sequence[str],
    people: Sequence[Individual],
    texts: Sequence[str],
    theme: str,
    **where: Any,
) -> None:
    """A row an individual, a column a source: filled where its subset has it."""
    figure.add_heatmap(
        x=list(sources),
        y=list(range(1, len(people) + 1)),
        z=[[int(name in one.subset) for name in sources] for one in people],
        zmin=0,
        zmax=1,
        colorscale=[[0, LOOKS[read_theme(theme)].faint], [1, ACCENT]],
        showscale=False,
        xgap=2,
        text=[[text] * len(sources) for text in texts],
        hovertemplate="%{text}<extra></extra>",
        **where,
    )


def _scores(figure: go.Figure, history: PopulationHistory, shown: Sequence[Individual]) -> None:
    """Scores as dots; failed individuals as crosses beyond the worst score."""
    scored = [(rank, one) for rank, one in enumerate(shown, start=1) if not one.failed]
    failed = [(rank, one) for rank, one in enumerate(shown, start=1) if one.failed]
    # Past the medians, too, which share the axis.
    edge = beyond([*(one.score for _, one in scored), *history.median])
    for name, group, marker in (
        ("individual", scored, {"symbol": "circle", "size": 7, "color": ACCENT}),
        (FAILED_NAME, failed, {"symbol": "x", "size": 8, "color": FAILED}),
    ):
        if group:
            figure.add_scatter(
                x=[edge if one.failed else one.score for _, one in group],
                y=[rank for rank, _ in group],
                mode="markers",
                marker=marker,
                name=name,
                text=[_described(one, history.metric) for _, one in group],
                hovertemplate="%{text}<extra></extra>",
                row=2,
                col=2,
            )


def _axes(figure: go.Figure, history: PopulationHistory, shown: int) -> None:
    figure.update_xaxes(type="category", showgrid=False, col=1)
    figure.update_xaxes(title_text="source", row=2, col=1)
    # plotly counts axes row by row: x4 is the one below.
    figure.update_xaxes(matches="x4", row=1, col=2)
    figure.update_xaxes(title_text=metric_label(history.metric), row=2, col=2)
    figure.update_yaxes(tickformat="d", showgrid=False)
    # From large to small: time runs down, and the best is on top.
    time, ranks = [history.generations - 0.5, -0.5], [shown + 0.5, 0.5]
    numbers = whole_ticks(0, history.generations - 1)
    figure.update_yaxes(title_text="generation (number)", range=time, tickvals=numbers, row=1, col=1)
    figure.update_yaxes(
        title_text="individual (rank)", range=ranks, tickvals=whole_ticks(1, shown), row=2, col=1
    )


def _answer(history: PopulationHistory, shown: int) -> str:
    first = history.individuals[0]
    if first.failed:
        return f"generation {history.generation}: no individual has a score"
    text = f"generation {history.generation}: {_described(first, history.metric)} leads"
    total = len(history.individuals)
    return text if shown == total else f"{text}; the best {shown} of {total} individuals"


def _described(one: Individual, metric: str | None) -> str:
    score = "failed" if one.failed else score_text(metric, one.score)
    return f"{{{', '.join(one.subset)}}} with {score}"


GENERATION = "generation (number)"


def evolution_figure(
    evolution: Evolution, *, theme: str = "auto", archive: int = 8, height: int | None = None
) -> go.Figure:
    """Draw sizes and diversity over time, and the best unique subsets of all generations.

    Args:
        evolution: from :func:`~sfkit.analysis.evolution.evolution`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        archive: how many of the best subsets to list.
        height: of the figure in pixels; by the number of subsets unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = make_subplots(
        rows=2,
        cols=2,
        column_widths=[0.45, 0.55],
        row_heights=[0.55, 0.45],
        horizontal_spacing=0.18,
        vertical_spacing=0.08,
        specs=[[{}, {"rowspan": 2}], [{}, None]],
    )
    muted = LOOKS[read_theme(theme)].muted
    low, mean, high = zip(*evolution.sizes, strict=True)
    for name, values, line in (
        ("largest subset", high, {"color": muted, "dash": "dot"}),
        ("mean size", mean, {"color": ACCENT, "width": 2}),
        ("smallest subset", low, {"color": muted, "dash": "dash"}),
    ):
        _over_time(figure, 1, name, values, line)
    _over_time(figure, 2, "diversity", evolution.diversity, {"color": ACCENT, "width": 2})
    best = evolution.archive[:archive]
    _archive(figure, evolution, best, theme)
    generations = whole_ticks(0, evolution.history.generations - 1)
    figure.update_xaxes(tickvals=generations, col=1)
    # x3 is the one below: the panel at the right spans both rows.
    figure.update_xaxes(matches="x3", showticklabels=False, row=1, col=1)
    figure.update_xaxes(title_text=GENERATION, row=2, col=1)
    figure.update_yaxes(title_text="size (sources)", rangemode="tozero", tickformat="d", row=1, col=1)
    figure.update_yaxes(title_text="diversity (fraction)", range=[-0.03, 1.03], row=2, col=1)
    figure.update_xaxes(title_text="source", type="category", showgrid=False, col=2)
    figure.update_yaxes(
        title_text="best subsets (rank and score)",
        range=[max(len(best), 1) + 0.5, 0.5],
        showgrid=False,
        col=2,
    )
    return finish(
        figure,
        theme=theme,
        title="Does the population agree?",
        subtitle=_settled(evolution),
        height=height or max(560, 26 * len(best) + 260),
    )


def _over_time(
    figure: go.Figure, row: int, name: str, values: tuple[float, ...], line: Mapping[str, object]
) -> None:
    drawn = drawn_points(len(values)).tolist()
    figure.add_scatter(
        x=drawn,
        y=[values[n] for n in drawn],
        mode="lines+markers" if len(drawn) == 1 else "lines",
        line=line,
        name=name,
        showlegend=row == 1,  # diversity is alone in its panel, whose axis names it
        hovertemplate="generation %{x}: %{y:.3g}<extra>" + name + "</extra>",
        row=row,
        col=1,
    )


def _archive(figure: go.Figure, evolution: Evolution, best: tuple[int, ...], theme: str) -> None:
    """Rows of membership marks, labelled with rank and score."""
    people = [evolution.individuals[number] for number in best]
    texts = [", ".join(one.subset) for one in people]
    _marks(figure, evolution.history.sources, people, texts, theme, name="archive", ygap=2, row=1, col=2)
    scores = [score_text(evolution.history.metric, one.score) for one in people]
    words = [f"{rank}: {score}" for rank, score in enumerate(scores, 1)]
    figure.update_yaxes(tickvals=list(range(1, len(words) + 1)), ticktext=words, row=1, col=2)


def _settled(evolution: Evolution) -> str:
    first, last = evolution.diversity[0], evolution.diversity[-1]
    low, _, high = evolution.sizes[-1]
    sizes = f"{low} sources" if low == high else f"{low} to {high} sources"
    return f"two individuals differ by {first:.2f} at first and {last:.2f} at the end, in subsets of {sizes}"
