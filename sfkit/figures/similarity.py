"""Whose data look like the target? Distances between data sets, a panel a cue."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.similarity import DataSimilarity
from sfkit.colours import SHARE
from sfkit.errors import InputError
from sfkit.figures.heatmaps import CELL, matrix
from sfkit.figures.theme import finish


def similarity_figure(
    similarities: Sequence[DataSimilarity], *, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw how far each source's data are from each target's, by each cue; dark is near.

    Args:
        similarities: from :func:`~sfkit.analysis.similarity.data_similarity`, of one pool and one list of
            targets.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of sources unless given.

    Raises:
        InputError: none to draw, or an unknown theme.
    """
    if not similarities:
        raise InputError("similarity: found none, expected at least one cue to draw")
    count = len(similarities)
    figure = make_subplots(
        rows=1,
        cols=count,
        shared_yaxes=True,
        horizontal_spacing=0.03,
        subplot_titles=[each.cue for each in similarities],
    )
    for number, each in enumerate(similarities, start=1):
        # A floor, for a target that all sources are equally near.
        scaled = each.distances / each.distances.max(axis=0, keepdims=True).clip(1e-12)
        trace = matrix(
            scaled,
            each.sources,
            each.targets,
            name=each.cue,
            unit="distance (of the farthest source's)",
            stops=SHARE,
            limits=(0.0, 1.0),
            form=".2f",
            hover="%{y} to %{x}: %{z:.2f} of the farthest source's distance",
        )
        # One key: all panels share its range.
        figure.add_trace(trace.update(showscale=number == count), row=1, col=number)
    figure.update_yaxes(type="category", autorange="reversed")
    figure.update_yaxes(title_text="source", col=1)
    figure.update_xaxes(type="category", title_text="target", tickangle=-40)
    first = similarities[0]
    nearest = [", ".join(each.subset(target, 1)[0] for each in similarities) for target in first.targets[:1]]
    cues = ", ".join(each.cue for each in similarities)
    return finish(
        figure,
        theme=theme,
        title="Whose data look like the target?",
        subtitle=f"nearest to {first.targets[0]} by {cues}: {nearest[0]}; dark is near",
        height=height or CELL * len(first.sources) + 290,
        margin={"b": 120},
    )
