"""Runs on disk: what searches did, read from the journals they leave for those who watch."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from sfkit.errors import InputError, SfkitWarning, nearest
from sfkit.outside import read_json
from sfkit.search.journal import JournalledSearch, read_journal
from sfkit.search.run_folder import NAMES, SEARCH

JOURNAL = "journal.jsonl"
STAGES = {"subset": "Stage 1", "routing": "Stage 2"}


class State(StrEnum):
    """What became of a stage, as far as its journal tells."""

    FINISHED = "finished"
    STOPPED = "stopped"
    OPEN = "open"  # no end was written: it runs, or it was interrupted and goes on when started again


@dataclass(frozen=True)
class StageRun:
    """The latest run of one stage.

    Attributes:
        stage: ``Stage 1`` or ``Stage 2``.
        state: finished, stopped or open.
        reason: why it ended, None while open.
        generation: the last finished one.
        score: the best so far, in the metric's unit; None where nothing has a finite score.
        subset: the best candidate's sources.
        recipe: the best candidate's recipe as plain values.
        counts: evaluations: candidates, distinct, cached, failed, seconds, seconds_saved, cpu_seconds,
            cpu_seconds_saved; the last two None, or left out by earlier versions, where not known.
        settings: the search's settings, with constraints and names.
        started: when this run began.
        written: when it last wrote.
    """

    stage: str
    state: State
    reason: str | None
    generation: int
    score: float | None
    subset: tuple[str, ...]
    recipe: Mapping[str, Any] | None
    counts: Mapping[str, Any]
    settings: Mapping[str, Any]
    started: datetime
    written: datetime


@dataclass(frozen=True)
class Run:
    """One folder with a journal: the latest run of each stage in it."""

    folder: Path
    stages: tuple[StageRun, ...]


def find_runs(root: str | Path) -> tuple[Run, ...]:
    """Every run under a folder, the one written last first.

    Raises:
        InputError: there is no such folder.

    Warns (:class:`~sfkit.errors.SfkitWarning`) of each journal that cannot be read.
    """
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{root}: no such folder, expected one with the folders of searches in it")
    runs = []
    for path in root.rglob(JOURNAL):
        try:
            runs.append(read_run(path.parent))
        except InputError as error:
            # One damaged folder must not hide the others.
            warnings.warn(str(error), SfkitWarning, stacklevel=2)
    # A search that was killed before its first generation has nothing to show.
    begun = [run for run in runs if run.stages]
    return tuple(sorted(begun, key=lambda run: run.stages[-1].written, reverse=True))


def read_run(folder: str | Path) -> Run:
    """The run in one folder.

    Raises:
        InputError: there is no journal in it (the nearest folder with one is suggested), or it is damaged.
    """
    folder = Path(folder)
    if not (folder / JOURNAL).is_file():
        beside = [path.parent.name for path in folder.parent.glob(f"*/{JOURNAL}")]
        raise InputError(
            f"{folder}: holds no {JOURNAL}, expected a search's folder{nearest(folder.name, beside)}"
        )
    records = read_journal(folder / JOURNAL)
    try:
        found = [JournalledSearch.find(records, kind) for kind in STAGES]
    except InputError as error:
        raise InputError(f"{folder / JOURNAL}: {str(error).removeprefix('journal: ')}") from error
    return Run(folder, tuple(_stage(search) for search in found if search is not None and search.generations))


def _stage(found: JournalledSearch) -> StageRun:
    best = found.best or {}
    return StageRun(
        stage=STAGES[found.kind],
        state=State.OPEN if found.end is None else State.STOPPED if found.stopped else State.FINISHED,
        reason=found.reason,
        generation=found.generation,
        score=best.get("score"),
        subset=tuple(best.get("subset", ())),
        recipe=best.get("recipe"),
        counts=found.counts,
        settings={
            k: found.start[k]
            for k in ("settings", "constraints", "sources", "blocks", "start")
            if k in found.start
        },
        started=found.started,
        written=found.written,
    )


def run_rows(runs: Iterable[Run]) -> list[dict[str, Any]]:
    """What ``sfkit runs list`` shows, one row a stage: column -> value."""
    return [
        {
            "run": str(run.folder),
            "stage": stage.stage,
            "state": stage.state.value,
            "generation": stage.generation,
            "best": stage.score,
            "subset": "+".join(stage.subset),
            "evaluations": int(stage.counts["distinct"]),
            "cached": int(stage.counts["cached"]),
            "failed": int(stage.counts["failed"]),
            "seconds": float(stage.counts["seconds"]),
            "cpu_seconds": stage.counts.get("cpu_seconds"),
            "written": stage.written.isoformat(timespec="seconds"),
        }
        for run in runs
        for stage in run.stages
    ]


def run_differences(first: Run, second: Run) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Two runs side by side: results, and every setting in which they differ.

    Raises:
        InputError: both are the same folder.
    """
    if first.folder.resolve() == second.folder.resolve():
        raise InputError(f"{first.folder}: named twice, expected the folders of two searches to compare")
    left, right = _facts(first), _facts(second)
    rows: list[tuple[Any, ...]] = []
    for key in dict.fromkeys((*left, *right)):
        one, other = left.get(key, "none"), right.get(key, "none")
        # What two runs are compared for is shown although it agrees.
        if one != other or key[1] in ("state", "best", "subset", "evaluations"):
            rows.append((*key, one, other, one != other))
    return ["stage", "what", str(first.folder), str(second.folder), "differs"], rows


def _facts(run: Run) -> dict[tuple[str, str], str]:
    facts: dict[tuple[str, str], str] = {}
    for stage in run.stages:
        results = {
            "state": stage.state.value,
            "best": stage.score,
            # Sorted: two searches that found one subset agree in it, in whatever order.
            "subset": "+".join(sorted(stage.subset)),
            "evaluations": stage.counts["distinct"],
        }
        settings = {**stage.settings, "recipe": stage.recipe or {}}
        for name, value in [*results.items(), *_flat(settings)]:
            facts[stage.stage, name] = str(value)
    return facts


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def recorded_metrics(path: Path, label: Callable[[str], str]) -> str | None:
    """The metrics that guided the search of a folder, as ``label`` has each; None where it does not say them.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where what should say so cannot be read: one damaged search
    keeps nobody from looking at the others.
    """
    try:
        return ", ".join(map(label, _recorded(path, "metrics"))) or None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        told = f"{path / SEARCH}: does not say which search this is ({error})"
        warnings.warn(told, SfkitWarning, stacklevel=2)
        return None


def recorded_benchmarks(path: Path) -> str | None:
    """The names of the benchmarks that guided the search of a folder; None where it does not say them."""
    try:
        return ", ".join(map(str, _recorded(path, NAMES))) or None
    except (InputError, KeyError, TypeError):  # of an earlier version, or damaged, which metrics tell
        return None


def _recorded(path: Path, key: str) -> list[str]:
    record = path / SEARCH
    return list(read_json(record)[key]) if record.is_file() else []
