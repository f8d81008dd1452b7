"""Where a training keeps what it writes beside its network."""

from __future__ import annotations

from pathlib import Path

TRAINED = "sfkit.training"
"""The entry in which a source says how it was trained."""

RECORD = "training.json"
"""What a training that is done says of itself, its seconds among it."""

OUTPUTS = ("training.csv", RECORD)
"""What a training leaves in its folder, besides its states."""

LOCK = ".lock"
"""Held as long as a training runs; the system frees it when the process ends, however it ends."""

PROGRESS = "progress.json"
"""How far a training is and the seconds that took, while it is not done."""


def training_folder(out: Path) -> Path:
    """Where a training keeps its states and its curve."""
    return out.with_name(f"{out.stem}.training")
