"""What sources were fine-tuned on, for questions about data rather than networks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sfkit import bank
from sfkit.datasets import Benchmark, open_benchmarks
from sfkit.errors import InputError


def open_source_data(
    entries: str | Mapping[str, str | Mapping[str, Any]], *, pairs: int = 4
) -> dict[str, Benchmark]:
    """Open what sources were fine-tuned on, for :func:`sfkit.analysis.data_similarity`: source -> pairs.

    Args:
        entries: a bank's name, such as ``"bank"``, for held-out pairs of its domains; else source name ->
            entry as for :func:`sfkit.open_benchmarks`.
        pairs: the first so many pairs of each.

    Raises:
        InputError: another word, or as :func:`sfkit.open_benchmarks` says.
    """
    if not isinstance(entries, Mapping):
        if entries not in bank.banks():
            raise InputError(
                f"source data: found {entries!r}, expected {' or '.join(map(repr, bank.banks()))}, or "
                "source -> benchmark"
            )
        return {name: bank.held_out(name, pairs, of=entries) for name in bank.training_seconds(entries)}
    opened = open_benchmarks(entries.values())
    return {source: each.first(pairs) for source, each in zip(entries, opened, strict=True)}
