"""Scores of several networks on several benchmarks, as a grid; and who belongs in such a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True)
class ScoreColumn:
    """One benchmark and metric.

    Attributes:
        benchmark: its name.
        metric: such as ``bad-1.0``.
        unit: ``%`` or ``px``.
        validation: True where it guided a search, so that its scores are no test.
    """

    benchmark: str
    metric: str
    unit: str
    validation: bool


@dataclass(frozen=True, eq=False)
class ScoreGrid:
    """What a score figure draws; N networks, C columns.

    Attributes:
        networks: N names, in the order they were scored.
        columns: the C benchmarks and metrics.
        values: (N, C), lower is better; NaN where the network failed or was not scored.
    """

    networks: tuple[str, ...]
    columns: tuple[ScoreColumn, ...]
    values: NDArray[np.float64]

    @property
    def benchmarks(self) -> tuple[str, ...]:
        """The benchmarks' names, in order."""
        return tuple(dict.fromkeys(column.benchmark for column in self.columns))

    @property
    def metrics(self) -> tuple[str, ...]:
        """The metrics, in order."""
        return tuple(dict.fromkeys(column.metric for column in self.columns))


def score_grid(scores: pd.DataFrame) -> ScoreGrid:
    """The grid of a table that :func:`~sfkit.evaluation.table.score_recipes` made.

    Raises:
        InputError: no row, or a network scored twice on one benchmark and metric.
    """
    if scores.empty:
        raise InputError("scores: found no row, expected what score_recipes returns for at least one recipe")
    networks = tuple(str(name) for name in scores["network"].unique())
    columns: list[ScoreColumn] = []
    values = []
    for (name, metric), part in scores.groupby(["benchmark", "metric"], sort=False):
        if part["network"].duplicated().any():
            raise InputError(
                f"scores: found a network twice on {name} {metric}, expected each once: "
                "give every benchmark its own name"
            )
        validation = bool((part["role"] == "validation").any())
        columns.append(ScoreColumn(str(name), str(metric), str(part["unit"].iloc[0]), validation))
        # Where a network was not scored, reindexing leaves NaN.
        values.append(part.set_index("network")["score"].reindex(list(networks)).to_numpy(np.float64))
    return ScoreGrid(networks, tuple(columns), np.stack(values, axis=1))


def contenders(pool: Pool, found: Mapping[str, Recipe] | None = None) -> dict[str, Recipe]:
    """The recipes every comparison shows: base, each source alone, uniform; then what was found.

    Raises:
        InputError: a name in ``found`` is already that of another row.
    """
    rows = {**pool.alone(), "uniform": pool.uniform()}
    for name, recipe in (found or {}).items():
        if name in rows:
            raise InputError(f"contenders: found {name!r} twice, expected another name than the pool's own")
        rows[name] = recipe
    return rows
