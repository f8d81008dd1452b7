"""All searches of a folder at a glance: how fast each got where it got, and what it owes to which source."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfkit.datasets.metric import with_unit
from sfkit.search.journal import JournalledSearch, journalled_score, read_journal
from sfkit.search.operators import SMALLEST
from sfkit.search.runs import JOURNAL, STAGES, Run, StageRun, recorded_metrics


@dataclass(frozen=True)
class RoutedCandidate:
    """One candidate of Stage 2.

    Attributes:
        number: of the evaluation, from 0.
        score: in the metric's unit.
        weights: source -> its weight, the mean over blocks.
        scales: block -> the scale of its module.
    """

    number: int
    score: float
    weights: Mapping[str, float]
    scales: Mapping[str, float]


@dataclass(frozen=True)
class StageOverview:
    """One stage of one search.

    Attributes:
        run: what the run table says of it.
        best_so_far: the best score after each candidate, by number; infinite before the first finite one.
        importance: Stage 1: source -> how much the best score rises among the subsets without it, in the
            metric's unit; infinite where every subset that was scored has it. Empty for Stage 2.
        routes: Stage 2: the candidates with a finite score. Empty for Stage 1.
    """

    run: StageRun
    best_so_far: tuple[float, ...]
    importance: Mapping[str, float]
    routes: tuple[RoutedCandidate, ...]


@dataclass(frozen=True)
class RunOverview:
    """One search: its folder, and the stages that have begun."""

    folder: Path
    stages: tuple[StageOverview, ...]


@dataclass(frozen=True)
class ParallelAxes:
    """Routes as lines over parallel axes, each of which goes from its lowest value to its highest.

    Attributes:
        names: of the axes: sources' weights, blocks' scales, the score.
        lows: lowest value on each axis.
        highs: highest value on each axis.
        lines: positions of the routes in the order of drawing, the best score last and so on top.
        best: positions of the best tenth, at least one.
        values: (routes, axes) where each line crosses each axis.
    """

    names: tuple[str, ...]
    lows: tuple[float, ...]
    highs: tuple[float, ...]
    lines: tuple[int, ...]
    best: frozenset[int]
    values: tuple[tuple[float, ...], ...]


def parallel_axes(routes: Sequence[RoutedCandidate]) -> ParallelAxes:
    """Routes as lines; at least one."""
    values = tuple((*route.weights.values(), *route.scales.values(), route.score) for route in routes)
    columns = tuple(zip(*values, strict=True))
    # What is drawn last lies on top.
    lines = tuple(sorted(range(len(routes)), key=lambda number: -routes[number].score))
    return ParallelAxes(
        names=(*routes[0].weights, *routes[0].scales, "score"),
        lows=tuple(map(min, columns)),
        highs=tuple(map(max, columns)),
        lines=lines,
        best=frozenset(lines[-max(len(lines) // 10, 1) :]),
        values=values,
    )


COLUMNS = ("run", "stage", "state", "metric", "best", "subset", "scored", "stored", "wall s", "CPU s")
"""Of the table of all searches: scored are its distinct evaluations, stored those that the store had."""


def run_cells(folder: str, metric: str, stage: StageOverview) -> list[tuple[str, float | str]]:
    """A row of the table: what each cell says, and what its column is sorted by; infinite where unknown."""
    run = stage.run
    score = ("none yet", math.inf) if run.score is None else (f"{run.score:.2f}", run.score)
    counts = [_counted(run.counts.get(name)) for name in ("distinct", "cached", "seconds", "cpu_seconds")]
    return [
        (folder, folder),
        (run.stage, run.stage),
        (run.state.value, run.state.value),
        (metric or "not recorded", metric),
        score,
        (", ".join(run.subset), len(run.subset)),
        *counts,
    ]


def _counted(value: float | None) -> tuple[str, float]:
    return ("–", math.inf) if value is None else (f"{value:.0f}", value)


def overviews(runs: Sequence[Run]) -> tuple[tuple[RunOverview, ...], dict[str, str]]:
    """Every search of :func:`~sfkit.search.runs.find_runs`; and folder -> metric and unit, where known."""
    return tuple(map(run_overview, runs)), {
        str(run.folder): recorded_metrics(run.folder, with_unit) or "" for run in runs
    }


def run_overview(run: Run) -> RunOverview:
    """What one search's journal tells.

    Raises:
        InputError: its journal is damaged.
    """
    records = read_journal(run.folder / JOURNAL)
    found = {STAGES[kind]: JournalledSearch.find(records, kind) for kind in STAGES}
    return RunOverview(run.folder, tuple(_stage(stage, found[stage.stage]) for stage in run.stages))


def _stage(run: StageRun, found: JournalledSearch | None) -> StageOverview:
    candidates = found.candidates if found is not None else ()
    best_so_far = tuple(itertools.accumulate(map(_competing, candidates), min))
    if found is None or found.kind == "routing":
        return StageOverview(run, best_so_far, {}, _routes(found, candidates) if found is not None else ())
    return StageOverview(run, best_so_far, source_importance(found.sources, candidates), ())


def _competing(entry: Mapping[str, Any]) -> float:
    """A candidate's score; infinite for a source alone, which teaches a model and wins nothing."""
    return journalled_score(entry) if len(entry["subset"]) >= SMALLEST else math.inf


def source_importance(sources: Sequence[str], candidates: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Source -> the best score among subsets without it minus the best of all; 0 for one the best can miss.

    It says what the archive knows, no more: a subset that was never scored may do better.
    """
    scored = [(set(entry["subset"]), _competing(entry)) for entry in candidates]
    best = min((score for _, score in scored), default=math.inf)
    if math.isinf(best):
        return {}
    return {
        source: min((score for subset, score in scored if source not in subset), default=math.inf) - best
        for source in sources
    }


def _routes(found: JournalledSearch, candidates: Sequence[Mapping[str, Any]]) -> tuple[RoutedCandidate, ...]:
    routes = []
    for entry in candidates:
        score, weights = journalled_score(entry), entry["weights"]
        if math.isfinite(score):
            mean = [sum(row[e] for row in weights) / len(weights) for e in range(len(found.sources))]
            scales = dict(zip(found.blocks, entry["scales"], strict=True))
            named = dict(zip(found.sources, mean, strict=True))
            routes.append(RoutedCandidate(int(entry["candidate"]), score, named, scales))
    return tuple(routes)
