"""Which source does each block prefer?"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from sfkit.analysis.labels import points
from sfkit.analysis.probes import BlockProbes
from sfkit.figures.heatmaps import CELL, matrix
from sfkit.figures.theme import finish


def probes_figure(probes: BlockProbes, *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw what it does to the score when one block follows one source and the rest the subset's mean.

    Args:
        probes: from :func:`~sfkit.analysis.probes.block_probes`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of blocks unless given.

    Raises:
        InputError: an unknown theme.
    """
    unit = points(probes.unit, full=True)
    figure = go.Figure(
        matrix(
            probes.values,
            probes.blocks,
            probes.sources,
            name="probe",
            unit=f"difference ({unit})",
            form="+.2f",
            hover="block %{y} from %{x}: %{z:+.2f}",
            notes=np.where(probes.noise, " ·", ""),
        )
    )
    figure.update_yaxes(type="category", autorange="reversed", title_text="block")
    figure.update_xaxes(type="category", title_text="source")
    liked = [f"{block}: {source}" for block, source in probes.preferred.items() if source]
    preferred = "; ".join(liked) or "none beyond noise"
    mark = " (it guided the search)" if probes.validation else ""
    return finish(
        figure,
        theme=theme,
        title="Which source does each block prefer?",
        subtitle=(
            f"change of {probes.metric} on {probes.benchmark}{mark} to the mean of the subset; "
            f"· within noise. Preferred: {preferred}"
        ),
        height=height or round(CELL * 1.6 * len(probes.blocks)) + 250,
    )
