"""Where a training keeps what it writes beside its network."""

from __future__ import annotations

from pathlib import Path

TRAINED = "sfkit.training"
"""The entry in which a source says how it was trained."""

OUTPUTS = ("training.csv", "training.json")
"""What a training leaves in its folder, besides its states."""


def training_folder(out: Path) -> Path:
    """Where a training keeps its states and its curve."""
    return out.with_name(f"{out.stem}.training")
