"""What a factory writes, and that none of it is somebody else's."""

from __future__ import annotations

from sfkit.errors import InputError
from sfkit.factory.file import Factory
from sfkit.search.run_folder import OUTPUTS

POOL, STORE, SEARCH, SCORES, COSTS = (
    "pool.toml",
    "evaluations.sqlite",
    "search",
    "scores.json",
    "costs.csv",
)
RECORD = "factory.json"
"""Says what networks, benchmarks and budgets the last search that ended was of."""
MADE_BY = "# Made by sfkit factory, which writes it anew; the factory's file says what is in it.\n"


def ensure_own(factory: Factory) -> None:
    """Refuse a folder in which files of a factory's names are no factory's: they would be replaced.

    Raises:
        InputError: names the file.
    """
    pool = factory.out / POOL
    if pool.is_file() and pool.read_bytes().startswith(MADE_BY.encode()):
        return
    names = (POOL, SCORES, COSTS, RECORD, *(f"{SEARCH}/{name}" for name in OUTPUTS))
    for path in (factory.out / name for name in names):
        if path.exists():
            raise InputError(
                f"{factory.file}: {path} exists, was made by no factory and would be replaced: give out = "
                "another folder, or move it away"
            )
