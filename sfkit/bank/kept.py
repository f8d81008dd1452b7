"""Rendered pairs kept on disk: read again where they are whole, rendered anew where they are not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sfkit.files import writing

Pair = TypeVar("Pair")


def recall(path: Path, make: Callable[[Mapping[str, Any]], Pair]) -> Pair | None:
    """What ``make`` makes of a file's arrays, by their names; None where it is absent or torn by a kill."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as held:
            return make(held)
    except Exception:  # numpy raises what the bytes come to
        return None


def keep(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays under their names; whole, or not at all."""
    with writing(path, durable=False) as fresh, fresh.open("wb") as stream:
        np.savez(stream, **arrays)
