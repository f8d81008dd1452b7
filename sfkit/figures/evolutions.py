"""Stage 1 as it settles: how big subsets are, how much individuals differ, and the best subsets of all."""

from __future__ import annotations

from collections.abc import Mapping

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.evolution import Evolution
from sfkit.analysis.labels import score_text
from sfkit.analysis.thinning import drawn_points
from sfkit.figures.axes import whole_ticks
from sfkit.figures.theme import ACCENT, LOOKS, finish, read_theme

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
    _archive(figure, evolution, best, LOOKS[read_theme(theme)].faint)
    generations = whole_ticks(0, evolution.history.generations - 1)
    figure.update_xaxes(tickvals=generations, col=1)
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
        subtitle=_answer(evolution),
        height=height or max(560, 26 * len(best) + 260),
    )


def _over_time(
    figure: go.Figure, row: int, name: str, values: tuple[float, ...], line: Mapping[str, object]
) -> None:
    drawn = drawn_points(len(values)).tolist()
    figure.add_trace(
        go.Scatter(
            x=drawn,
            y=[values[n] for n in drawn],
            mode="lines+markers" if len(drawn) == 1 else "lines",
            line=line,
            name=name,
            showlegend=row == 1,  # diversity is alone in its panel, whose axis names it
            hovertemplate="generation %{x}: %{y:.3g}<extra>" + name + "</extra>",
        ),
        row=row,
        col=1,
    )


def _archive(figure: go.Figure, evolution: Evolution, best: tuple[int, ...], faint: str) -> None:
    """Rows of membership marks, labelled with rank and score."""
    sources, metric = evolution.history.sources, evolution.history.metric
    people = [evolution.individuals[number] for number in best]
    ranks = list(range(1, len(people) + 1))
    figure.add_trace(
        go.Heatmap(
            x=list(sources),
            y=ranks,
            z=[[int(name in one.subset) for name in sources] for one in people],
            zmin=0,
            zmax=1,
            colorscale=[[0, faint], [1, ACCENT]],
            showscale=False,
            xgap=2,
            ygap=2,
            name="archive",
            text=[[", ".join(one.subset)] * len(sources) for one in people],
            hovertemplate="%{text}<extra></extra>",
        ),
        row=1,
        col=2,
    )
    words = [f"{rank}: {score_text(metric, one.score)}" for rank, one in zip(ranks, people, strict=True)]
    figure.update_yaxes(tickvals=ranks, ticktext=words, row=1, col=2)


def _answer(evolution: Evolution) -> str:
    first, last = evolution.diversity[0], evolution.diversity[-1]
    low, _, high = evolution.sizes[-1]
    sizes = f"{low} sources" if low == high else f"{low} to {high} sources"
    return f"two individuals differ by {first:.2f} at first and {last:.2f} at the end, in subsets of {sizes}"
