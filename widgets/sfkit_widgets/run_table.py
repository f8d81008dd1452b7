"""RunTable: all searches of a folder, sortable; how fast each got where it got, and what it owes to whom."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import traitlets

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.run_overview import (
    COLUMNS,
    RoutedCandidate,
    StageOverview,
    overviews,
    parallel_axes,
    run_cells,
)
from sfkit.files import home
from sfkit.search.runs import find_runs
from sfkit_widgets._assets import script, style
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._commands import command
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._still_sheets import runs_sheet

LINES = 200
"""At most so many candidates of one Stage 2 reach the browser as lines, the best tenth among them."""


class RunTable(SfkitWidget):
    """Every search under a folder; what ``sfkit runs page`` writes, as a widget.

    Args:
        folder: with the folders of searches in it.
        settings: ``theme`` and ``layout``.

    Raises:
        InputError: no such folder, or an argument of another name.
    """

    _esm = script("run_table.js")
    _css = style("charts.css", "run_table.css")

    columns = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Headings of the table.

    - Type: `list[str]`
    """

    rows = traitlets.List(traitlets.Dict()).tag(sync=True)
    """One a stage, see :func:`shown_stage`; the search written last first.

    - Type: `list[dict[str, Any]]`, scores in each metric's unit
    - Default: `[]`
    """

    def __init__(self, folder: str | os.PathLike[str] = "runs", **settings: Any) -> None:
        self.folder = home(folder)
        # Before the folder is read, which can take long.
        self.refuse_unknown(settings)
        super().__init__(settings, columns=list(COLUMNS), rows=read_rows(self.folder))

    @command
    def read(self) -> None:
        """Look again at what is in the folder now."""
        self.rows = read_rows(self.folder)

    def sheet(self) -> Sheet:
        """The table, and how the search written last went on."""
        return runs_sheet(self.columns, self.rows)


def read_rows(folder: Path) -> list[dict[str, Any]]:
    """What the table shows of a folder.

    Raises:
        InputError: no such folder.
    """
    found, metrics = overviews(find_runs(folder))
    return [
        shown_stage(_name(run.folder, folder), metrics[str(run.folder)], stage)
        for run in found
        for stage in run.stages
    ]


def _name(run: Path, root: Path) -> str:
    """A search's folder as seen from where it was looked for."""
    return run.name if run == root else str(run.relative_to(root))


def shown_stage(folder: str, metric: str, stage: StageOverview) -> dict[str, Any]:
    """What the script draws of one stage, as JSON values; None stands for a number that is not finite.

    ``cells``, text and sort key of each column; ``metric`` with its unit and ``stage``, by which searches are
    compared; ``numbers`` of at most 400 candidates and the ``best`` score after each; ``importance``, pairs
    of source and rise (None: it is in every subset that was scored), the largest first; ``axes`` of Stage 2,
    see :func:`shown_axes`, None without a candidate.
    """
    best = stage.best_so_far
    improved = [n for n in range(1, len(best)) if best[n] < best[n - 1]]
    drawn = drawn_points(len(best), improved).tolist()
    rises = sorted(stage.importance.items(), key=lambda pair: -pair[1])
    return {
        "cells": [
            [text, key if isinstance(key, str) else _finite(key)]
            for text, key in run_cells(folder, metric, stage)
        ],
        "metric": metric,
        "stage": stage.run.stage,
        "numbers": drawn,
        "best": [_finite(best[n]) for n in drawn],
        "importance": [[source, _finite(rise)] for source, rise in rises],
        "axes": shown_axes(stage.routes) if stage.routes else None,
    }


def shown_axes(routes: Sequence[RoutedCandidate]) -> dict[str, Any]:
    """Parallel coordinates of Stage 2.

    ``names``, ``lows`` and ``highs`` of the axes; ``lines``, the values of at most 200 candidates, the best
    drawn last, and their ``numbers``; ``leading``, how many at the end are of the best tenth.
    """
    axes = parallel_axes(routes)
    count = len(axes.lines)
    kept = drawn_points(count, range(count - len(axes.best), count), LINES).tolist()
    lines = [axes.lines[place] for place in kept]
    return {
        "names": list(axes.names),
        "lows": list(map(_finite, axes.lows)),
        "highs": list(map(_finite, axes.highs)),
        "numbers": [routes[line].number for line in lines],
        "lines": [list(map(_finite, axes.values[line])) for line in lines],
        "leading": sum(line in axes.best for line in lines),
    }


def _finite(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
