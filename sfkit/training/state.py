"""A training's state on disk: written whole or not at all, the last two kept."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from sfkit.errors import InputError
from sfkit.files import writing

KEPT = 2
_NAME = re.compile(r"state-(\d{8})\.pt")
FORMAT = 1


def save_state(folder: Path, step: int, identity: str, values: Mapping[str, Any]) -> Path:
    """Write the state after ``step`` steps to a new file, flush, rename; then drop all but the last two."""
    path = folder / f"state-{step:08d}.pt"
    with writing(path) as fresh, fresh.open("wb") as stream:
        torch.save({"format": FORMAT, "identity": identity, "step": step, **values}, stream)
    for old in _states(folder)[:-KEPT]:
        old.unlink(missing_ok=True)
    return path


def last_state(folder: Path, identity: str) -> dict[str, Any] | None:
    """The newest state that can be read; None where there is none.

    Raises:
        InputError: the state is that of another training, or none of those there can be read.
    """
    states = _states(folder)
    # The newest that can be read: the last write may be the one that was torn.
    for path in reversed(states):
        try:
            state = torch.load(path, map_location="cpu", weights_only=True)
        except Exception:  # torch interprets the bytes one by one, and raises what that comes to
            continue  # a disk may fail after the rename; the one before is kept for that
        if not isinstance(state, dict):
            continue
        if state.get("format") != FORMAT or state.get("identity") != identity:
            raise InputError(
                f"{path}: is the state of another training (other base, data, network or settings), expected "
                "this one's; give another output, or remove the folder to begin anew"
            )
        return state
    if states:
        raise InputError(f"{folder}: none of its {len(states)} states can be read, remove it to begin anew")
    return None


def saved_step(folder: Path) -> int | None:
    """The step of the newest state, which is not opened; None where there is none."""
    states = _states(folder)
    return int(states[-1].stem.removeprefix("state-")) if states else None


def _states(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if _NAME.fullmatch(path.name))
