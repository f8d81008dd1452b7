"""Evaluations as tables, and from one store into another."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pandas as pd

from sfkit.datasets.metric import D1, EPE, bad_pixels
from sfkit.errors import InputError
from sfkit.evaluation.metrics import THRESHOLDS, ImageErrors
from sfkit.evaluation.store import Evaluation, EvaluationStore, evaluation_key
from sfkit.files import write_bytes, write_text

COLUMNS = ("key", "image", "region", "pixels", EPE.name, D1.name, *(bad_pixels(t).name for t in THRESHOLDS))


def evaluation_table(store: EvaluationStore) -> pd.DataFrame:
    """One row an (evaluation, image, region), in the order they were written.

    Columns: those of the evaluation (``key``, ``failure``, ``seconds``, ``cpu_seconds``, ``benchmark``,
    ``protocol``, ``recipe`` as JSON), then ``image``, ``region``, ``pixels``, ``epe`` in pixels, ``d1`` and
    ``bad-t`` in percent. A failed evaluation has one row without an image.
    """
    return pd.DataFrame([row for evaluation in store for row in _rows(evaluation)])


def _rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    about = evaluation.description
    head = {
        "key": evaluation.key,
        "failure": evaluation.failure,
        "seconds": evaluation.seconds,
        "cpu_seconds": evaluation.cpu_seconds,
        "benchmark": about.get("benchmark"),
        "protocol": about.get("protocol"),
        "recipe": json.dumps(about.get("recipe"), sort_keys=True),
    }
    if evaluation.failure:
        return [head]
    return [
        {**head, "image": image.id, "region": region, "pixels": errors.pixels, **_values(image, region)}
        for image in evaluation.images
        for region, errors in image.regions.items()
    ]


def _values(image: ImageErrors, region: str) -> dict[str, float]:
    metrics = (EPE, D1, *map(bad_pixels, image.thresholds)) if image.region(region).pixels else ()
    return {metric.name: image.value(metric, region) for metric in metrics}


def export_evaluations(store: EvaluationStore, path: Path) -> Path:
    """Write the table as ``.csv`` or ``.parquet``.

    Raises:
        InputError: another ending, an existing file, or parquet without pyarrow.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: found the ending {path.suffix!r}, expected .csv or .parquet")
    if path.exists():
        raise InputError(f"{path}: the file exists, name another one")
    table = evaluation_table(store)
    if path.suffix == ".csv":
        return write_text(path, table.to_csv(index=False))
    try:
        return write_bytes(path, table.to_parquet(index=False))
    except ImportError as error:
        raise InputError(
            f"{path}: writing parquet needs pyarrow (pip install 'sfkit[parquet]'), or end it in .csv"
        ) from error


def import_evaluations(source: EvaluationStore, target: EvaluationStore) -> tuple[int, int]:
    """Copy evaluations into another store; where both have one, the target's stays.

    Returns:
        How many were copied, and how many the target had.

    Raises:
        InputError: a row is not what sfkit writes; nothing is copied then.
    """
    # All are looked at before one is written.
    for evaluation in source:
        check_evaluation(evaluation, str(source.path))
    copied = held = 0
    for evaluation in source:
        if take(evaluation, target):
            copied += 1
        else:
            held += 1
    return copied, held


def take(evaluation: Evaluation, target: EvaluationStore) -> bool:
    """Write an evaluation of another store; False where the target has one that stays."""
    known = target.get(evaluation.key)
    # A failure may have been its machine's, such as too little memory: a result takes its place.
    if known is not None and (known.failure is None or evaluation.failure is not None):
        return False
    target.put(evaluation)
    return True


def check_evaluation(evaluation: Evaluation, where: str) -> None:
    """Refuse an evaluation that no evaluator made: under another key than its own, or with impossible counts.

    Raises:
        InputError: names the evaluation and what is wrong.
    """
    place = f"{where}: evaluation {evaluation.key[:12]}"
    try:
        key = evaluation_key(evaluation.description)
    except ValueError as error:
        raise InputError(f"{place}: its description cannot have a key ({error})") from error
    if key != evaluation.key:
        raise InputError(f"{place}: its key is not the digest of its description, expected {key[:12]}")
    if evaluation.failure:
        return
    ids = [image.id for image in evaluation.images]
    if not ids or len(set(ids)) != len(ids):
        raise InputError(f"{place}: found the images {ids}, expected at least one and each once")
    for image in evaluation.images:
        _check_counts(image, f"{place}, image {image.id!r}")


def _check_counts(image: ImageErrors, place: str) -> None:
    if list(image.thresholds) != sorted(set(image.thresholds)) or not all(t > 0 for t in image.thresholds):
        raise InputError(
            f"{place}: found the thresholds {image.thresholds}, expected ascending numbers above 0"
        )
    for name, errors in image.regions.items():
        counts = (*errors.above, errors.d1)
        # Written so that NaN fails: no comparison with it holds.
        possible = errors.sum_abs >= 0 and all(0 <= count <= errors.pixels for count in counts)
        if not possible or image.nonfinite < 0 or errors.pixels < 0:
            raise InputError(
                f"{place}: found {errors} in region {name!r}, expected sums and counts of errors"
            )
    for name, (above, below) in image.own.items():
        if math.isnan(above) or not below >= 0:
            raise InputError(f"{place}: found {above} of {below} for {name}, expected a sum and a count")
