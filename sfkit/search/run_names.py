"""What a search's folder says of what guided it: metrics and benchmarks, by their names."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from sfkit.errors import InputError, SfkitWarning
from sfkit.outside import read_json
from sfkit.search.run_folder import NAMES, SEARCH


def recorded_metrics(path: Path, label: Callable[[str], str]) -> str | None:
    """The metrics that guided the search of a folder, as ``label`` has each; None where it does not say them.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where what should say so cannot be read: one damaged search
    keeps nobody from looking at the others.
    """
    record = path / SEARCH
    if not record.is_file():
        return None
    try:
        return ", ".join(map(label, read_json(record)["metrics"])) or None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        warnings.warn(f"{record}: does not say which search this is ({error})", SfkitWarning, stacklevel=2)
        return None


def recorded_benchmarks(path: Path) -> str | None:
    """The names of the benchmarks that guided the search of a folder; None where it does not say them."""
    record = path / SEARCH
    if not record.is_file():
        return None
    try:
        return ", ".join(map(str, read_json(record)[NAMES])) or None
    except (InputError, KeyError, TypeError):  # of an earlier version, or damaged, which metrics tell
        return None
