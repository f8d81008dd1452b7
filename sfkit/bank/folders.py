"""Where the banks' networks ship: their names and files alone, for whoever opens a pool by name."""

from __future__ import annotations

from pathlib import Path

from sfkit.merging.named import register_pool

FOLDERS = {"bank": "data", "bank-slim": "data-slim", "bank-sharp": "data-sharp"}
"""Bank -> the folder beside this file."""


def pool_file(name: str) -> Path:
    """The ``pool.toml`` of one of ``FOLDERS``; base and sources lie beside it."""
    return Path(__file__).parent / FOLDERS[name] / "pool.toml"


for _name in FOLDERS:
    if pool_file(_name).exists():
        register_pool(_name, pool_file(_name))
