"""Evaluations as tables, and from one store into another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from sfkit.datasets.metric import D1, EPE, bad_pixels
from sfkit.errors import InputError
from sfkit.evaluation.metrics import THRESHOLDS, ImageErrors
from sfkit.evaluation.store import Evaluation, EvaluationStore

COLUMNS = ("key", "image", "region", "pixels", EPE.name, D1.name, *(bad_pixels(t).name for t in THRESHOLDS))


def evaluation_table(store: EvaluationStore) -> pd.DataFrame:
    """One row an (evaluation, image, region), in the order they were written.

    Columns: those of the evaluation (``key``, ``failure``, ``seconds``, ``benchmark``, ``protocol``,
    ``recipe`` as JSON), then ``image``, ``region``, ``pixels``, ``epe`` in pixels, ``d1`` and ``bad-t`` in
    percent. A failed evaluation has one row without an image.
    """
    return pd.DataFrame([row for evaluation in store for row in _rows(evaluation)])


def _rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    about = evaluation.description
    head = {
        "key": evaluation.key,
        "failure": evaluation.failure,
        "seconds": evaluation.seconds,
        "benchmark": about.get("benchmark"),
        "protocol": about.get("protocol"),
        "recipe": json.dumps(about.get("recipe"), sort_keys=True),
    }
    if evaluation.failure:
        return [head]
    return [
        {
            **head,
            "image": image.id,
            "region": region,
            "pixels": errors.pixels,
            **_values(image, region),
        }
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
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
        return path
    try:
        table.to_parquet(path, index=False)
    except ImportError as error:
        raise InputError(
            f"{path}: writing parquet needs pyarrow (pip install 'sfkit[parquet]'), or end it in .csv"
        ) from error
    return path


def import_evaluations(source: EvaluationStore, target: EvaluationStore) -> tuple[int, int]:
    """Copy evaluations into another store; where both have one, the target's stays.

    Returns:
        How many were copied, and how many the target had.
    """
    copied = held = 0
    for evaluation in source:
        known = target.get(evaluation.key)
        if known is not None and (known.failure is None or evaluation.failure is not None):
            held += 1
            continue
        target.put(evaluation)
        copied += 1
    return copied, held
