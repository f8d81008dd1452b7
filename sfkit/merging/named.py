"""Pools that are opened by name: they come with sfkit, and have no path that users would know."""

from __future__ import annotations

import importlib
from pathlib import Path

SHIPPED = "sfkit.bank.folders"  # stands further right, and is imported when a name is looked up
_NAMED: dict[str, Path] = {}


def register_pool(name: str, path: Path) -> None:
    """Let :func:`~sfkit.merging.opening.open_pool` know a pool by name."""
    _NAMED[name] = path


def named_pool(path: str | Path) -> str | Path:
    """The ``pool.toml`` of a pool that is known by name; whatever else is given, as it is."""
    if not isinstance(path, str):
        return path
    importlib.import_module(SHIPPED)
    return _NAMED.get(path, path)
