"""Matrices as colours with their numbers written in: shared by the figures that draw them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from sfkit.colours import ERROR, Stops, plotly_scale

CELL = 26
"""Height of one row in pixels."""

WRITTEN = 200
"""Cells up to which numbers are written in; more would not be read."""


def matrix(
    values: NDArray[np.floating[Any]],
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    name: str,
    unit: str,
    stops: Stops = ERROR,
    limits: tuple[float, float] | None = None,
    form: str = ".1f",
    hover: str = "%{y}, %{x}: %{z:.3f}",
    notes: NDArray[np.str_] | None = None,
    bar: dict[str, Any] | None = None,
) -> go.Heatmap:
    """A heatmap of (R, C) values with numbers in its cells.

    Args:
        values: NaN is left blank.
        rows: R names.
        columns: C names.
        name: of the trace.
        unit: title of the colour bar.
        stops: the colour map; :data:`~sfkit.colours.ERROR` for differences, its middle at 0.
        limits: values of its ends; symmetric about 0 unless given.
        form: format of the numbers.
        hover: plotly's template.
        notes: (R, C) written behind the numbers, such as a mark of noise.
        bar: where the colour bar goes; None leaves it to plotly.
    """
    finite = np.abs(values[np.isfinite(values)])
    # Where all are 0 any end will do.
    end = float(finite.max()) if finite.size and finite.max() > 0 else 1.0
    # Symmetric, so that 0 has the middle colour.
    low, high = limits or (-end, end)
    noted = np.full(values.shape, "") if notes is None else notes
    text = [
        [f"{v:{form}}{note}" if np.isfinite(v) else "" for v, note in zip(*row, strict=True)]
        for row in zip(values, noted, strict=True)
    ]
    return go.Heatmap(
        x=list(columns),
        y=list(rows),
        # JSON has no NaN; None leaves the cell blank.
        z=[[float(v) if np.isfinite(v) else None for v in row] for row in values],
        zmin=low,
        zmax=high,
        colorscale=plotly_scale(stops),
        text=text,
        texttemplate="%{text}" if values.size <= WRITTEN else None,
        textfont={"size": 11},
        xgap=2,
        ygap=2,
        name=name,
        hovertemplate=f"{hover}<extra></extra>",
        colorbar={
            "title": {"text": unit, "side": "right"},
            "thickness": 12,
            "outlinewidth": 0,
            **(bar or {}),
        },
    )
