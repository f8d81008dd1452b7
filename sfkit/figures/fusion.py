"""What sets fusion strategies apart: what they select, and how finely they weigh it."""

from __future__ import annotations

from html import escape

import pandas as pd
import plotly.graph_objects as go

from sfkit.figures.theme import finish

FINENESS = ("global", "source", "block", "parameter", "not stated")
LINE = 17  # px, a method's name


def fusion_figure(table: pd.DataFrame, *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw each method at what it selects and at the granularity of its weights; how it weighs is on hover.

    Args:
        table: from :func:`sfkit.baselines.fusion_table`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of methods unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = go.Figure()
    cells = table.groupby(["selection", "granularity"], sort=False)
    for (selection, granularity), methods in cells:
        figure.add_scatter(
            x=[granularity],
            y=[selection],
            mode="text",
            text="<br>".join(map(escape, methods.index)),
            hovertext="<br>".join(
                escape(f"{method}: {weights}") for method, weights in methods["weights"].items()
            ),
            hoverinfo="text",
        )
    selections = list(dict.fromkeys(table["selection"]))
    fineness = [name for name in FINENESS if name in set(table["granularity"])]
    figure.update_xaxes(
        title_text="granularity of the weights",
        type="category",
        tickson="boundaries",  # lines between names, not through them
        categoryarray=fineness,
        # Half a cell beyond the ends: text by itself takes no room in plotly's ranges.
        range=[-0.5, len(fineness) - 0.5],
    )
    figure.update_yaxes(
        title_text="selection of sources",
        type="category",
        tickson="boundaries",
        categoryarray=selections,
        range=[len(selections) - 0.5, -0.5],
    )
    both = table[(table["selection"] != "all") & table["granularity"].isin(FINENESS[1:-1])]
    return finish(
        figure,
        theme=theme,
        title="Which methods both select sources and weigh them finely?",
        subtitle=", ".join(map(escape, both.index)) or "none",
        height=height or len(selections) * (LINE * max(map(len, cells.groups.values())) + 8) + 190,
        showlegend=False,
    )
