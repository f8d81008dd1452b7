"""Golden arrays, whole or the reduced set in ``tests/goldens``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

SHIPPED = Path(__file__).parent / "goldens"


class Reduced(dict[str, Any]):
    """A part of the arrays: a test that asks for another one skips."""

    def __missing__(self, key: str) -> Any:
        pytest.skip(f"{key} is no part of tests/goldens: SFKIT_GOLDENS names the folder of all golden arrays")


def golden_arrays(path: Path) -> dict[str, Any]:
    """The arrays of one file by name."""
    with np.load(path) as file:
        return Reduced(file) if SHIPPED in path.parents else dict(file)
