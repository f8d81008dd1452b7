"""What a training writes of itself beside its states: curve, how far it is, and what it took in the end."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from sfkit.files import is_held, write_text
from sfkit.outside import read_json
from sfkit.training.loop import Course, Listener
from sfkit.training.places import LOCK, PROGRESS, RECORD, training_folder
from sfkit.training.state import saved_step

COLUMNS = ("step", "loss", "gradient_norm", "rate")
TOLD_EVERY = 1.0  # seconds of training between two writings of how far it is


@dataclass(frozen=True)
class TrainingProgress:
    """How far a training that is not done is.

    Attributes:
        running: whether a process is at it now; otherwise it goes on from ``step`` when started again.
        step: steps done; of one that does not run, those that its newest state holds.
        pace: seconds a step so far, over all sittings; None before the first.
    """

    running: bool
    step: int
    pace: float | None


def recording(folder: Path, listen: Listener | None) -> Listener:
    """Keep ``training.csv`` and ``progress.json`` beside the states, so that a training can be watched."""
    written, told = 0, -TOLD_EVERY

    def record(course: Course) -> None:
        nonlocal written, told
        # Not at every step: the files are written whole each time.
        if course.done - written >= 50 or course.done == course.steps:
            written = course.done
            write_curve(folder, course)
        if course.seconds - told >= TOLD_EVERY:
            told = course.seconds
            values = {"step": course.done, "steps": course.steps, "seconds": course.seconds}
            write_text(folder / PROGRESS, json.dumps(values) + "\n", durable=False)
        if listen is not None:
            listen(course)

    return record


def write_curve(folder: Path, course: Course) -> None:
    """Write ``training.csv``: a row a step, with the validation metric where one was taken."""
    scores = {int(step): score for step, score, *_ in course.scores}
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, "validation"])
    for step, *numbers in course.curve:
        writer.writerow([int(step), *numbers, scores.get(int(step), "")])
    write_text(folder / "training.csv", text.getvalue())


def write_record(folder: Path, course: Course, made: Mapping[str, Any]) -> None:
    """Write ``training.json`` and the whole curve of a training that is done."""
    write_curve(folder, course)
    record = {**made, "broken": dict(course.broken)}
    write_text(folder / RECORD, json.dumps(record, indent=2, sort_keys=True) + "\n")
    (folder / PROGRESS).unlink(missing_ok=True)


def costs_of(out: Path) -> tuple[float | None, float | None]:
    """Seconds that the training of a file took, on the clock and of processors; None where none says it."""
    record = training_folder(out) / RECORD
    took = read_json(record) if record.is_file() else {}
    wall, worked = (took.get(key) for key in ("seconds", "cpu_seconds"))
    return None if wall is None else float(wall), None if worked is None else float(worked)


def progress_of(out: Path) -> TrainingProgress | None:
    """How far the training of a file is; None where none was begun.

    A training that was killed before it saved a state begins anew, but its pace is known.
    """
    folder = training_folder(out)
    running, saved = is_held(folder / LOCK), saved_step(folder)
    told = _told(folder)
    if not running and saved is None and told is None:
        return None
    step, pace = saved or 0, None
    if told is not None:
        step, pace = (told["step"] if running else step), told["seconds"] / told["step"]
    return TrainingProgress(running, step, pace)


def _told(folder: Path) -> dict[str, Any] | None:
    try:
        values = json.loads((folder / PROGRESS).read_text(encoding="utf-8"))
        return {key: values[key] for key in ("step", "seconds")} if values["step"] > 0 else None
    except (OSError, ValueError, KeyError, TypeError):  # not there yet, or no longer
        return None
