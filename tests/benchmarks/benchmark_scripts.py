"""Modules of the benchmarks, for tests that call what is in them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@contextmanager
def imported(*names: str) -> Iterator[tuple[ModuleType, ...]]:
    """These modules, importable as the scripts there import each other; gone again afterwards."""
    before = set(sys.modules)
    sys.path.insert(0, str(BENCHMARKS))
    yield tuple(map(import_module, names))
    sys.path.remove(str(BENCHMARKS))
    for name in set(sys.modules) - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(str(BENCHMARKS)):
            del sys.modules[name]
