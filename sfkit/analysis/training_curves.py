"""How trainings went: loss, rate and validation scores by step, out of ``training.csv``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.training.places import training_folder
from sfkit.training.record import COLUMNS

Values = NDArray[np.float64]
WINDOW = 50  # steps


@dataclass(frozen=True)
class TrainingCurve:
    """One training, all arrays by step.

    Attributes:
        name: the source's.
        steps: numbers of the steps that were taken, from 1 on.
        losses: of each step, in the loss's unit (pixels for smooth L1).
        smoothed: mean of the losses of the last 50 steps up to each; of fewer at the beginning.
        rates: the learning rate of each step.
        scores: step -> score on the validation pairs, where some were given to the training.
    """

    name: str
    steps: Values
    losses: Values
    smoothed: Values
    rates: Values
    scores: Mapping[int, float]


def training_curve(name: str, source: str | Path, *, window: int = WINDOW) -> TrainingCurve:
    """The curve of a source that was, or is being, fine-tuned.

    Args:
        name: what to call it.
        source: the checkpoint that ``sfkit finetune`` writes; its ``training.csv`` lies in a folder beside.
        window: steps to smooth over.

    Raises:
        InputError: there is no curve beside the source, or it is no table of ours.
    """
    path = training_folder(Path(source)) / "training.csv"
    if not path.is_file():
        raise InputError(
            f"{path}: not found, expected the curve of {source}: was it trained by sfkit finetune?"
        )
    table = pd.read_csv(path)
    missing = [column for column in (*COLUMNS, "validation") if column not in table]
    if missing:
        raise InputError(f"{path}: the column {missing[0]!r} is missing, expected {', '.join(COLUMNS)}")
    # The column is empty at the steps that scored nothing.
    scored = table.dropna(subset="validation")
    losses = table["loss"].to_numpy(dtype=np.float64)
    return TrainingCurve(
        name,
        steps=table["step"].to_numpy(dtype=np.float64),
        losses=losses,
        # Also the first steps have a value, over as many as there are.
        smoothed=pd.Series(losses).rolling(window, min_periods=1).mean().to_numpy(),
        rates=table["rate"].to_numpy(dtype=np.float64),
        scores={int(step): float(v) for step, v in zip(scored["step"], scored["validation"], strict=True)},
    )
