"""How large a population does Stage 1 need? The best score found, and what it cost, by population size."""

from __future__ import annotations

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.growth import PopulationSizes
from sfkit.analysis.labels import metric_label
from sfkit.figures.theme import ACCENT, LOOKS, WARM, finish, read_theme


def population_sizes_figure(
    record: PopulationSizes, *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw the best score and the number of subsets scored by population size: a dot a seed, a line the mean.

    Args:
        record: from :func:`~sfkit.analysis.growth.population_sizes`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; 380 unless given.

    Raises:
        InputError: an unknown theme.
    """
    muted = LOOKS[read_theme(theme)].muted
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.1)
    sizes = list(record.sizes)
    panels = (
        (record.best, ACCENT, "best score", "%{y:.3f}"),
        (record.distinct, WARM, "subsets scored", "%{y:,.0f}"),
    )
    for col, (values, colour, name, form) in enumerate(panels, 1):
        dots = [(size, float(v)) for size, row in zip(sizes, values, strict=True) for v in row]
        hover = f"M = %{{x}}: {form}<extra>{name}</extra>"
        figure.add_scatter(
            x=[x for x, _ in dots],
            y=[y for _, y in dots],
            mode="markers",
            marker={"size": 6, "color": colour, "opacity": 0.55},
            name=f"{name}, a seed",
            hovertemplate=hover,
            row=1,
            col=col,
        )
        figure.add_scatter(
            x=sizes,
            y=values.mean(axis=1).tolist(),
            mode="lines",
            line={"color": colour, "width": 2},
            name=f"{name}, mean",
            hovertemplate=hover,
            row=1,
            col=col,
        )
    if record.optimum is not None:
        line = {"color": muted, "dash": "dot", "width": 1}
        figure.add_hline(y=record.optimum, line=line, layer="below", row=1, col=1)
    figure.update_xaxes(title_text="population M (individuals)")
    figure.update_yaxes(
        title_text=metric_label(record.metric) if record.metric else "score (lower is better)", col=1
    )
    figure.update_yaxes(title_text="subsets scored (number)", rangemode="tozero", row=1, col=2)
    return finish(
        figure,
        theme=theme,
        title="How large a population does Stage 1 need?",
        subtitle=_answer(record),
        height=height or 380,
    )


def _answer(record: PopulationSizes) -> str:
    means = record.best.mean(axis=1)
    best = float(means.min())
    spread = float(record.best.max() - record.best.min())
    # The smallest that comes near: a larger population only costs more.
    near = next(size for size, mean in zip(record.sizes, means, strict=True) if mean <= best + 0.05 * spread)
    dotted = "; dotted: the best of all subsets" if record.optimum is not None else ""
    seeds = f"{len(record.seeds)} seed{'s' * (len(record.seeds) != 1)}"
    return (
        f"from M = {near} on the mean stays within 5 % of the range of all runs "
        f"({seeds}, T = {record.generations}){dotted}"
    )
