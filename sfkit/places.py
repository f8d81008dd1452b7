"""Names for what ships with sfkit, beside one's own files: the pool ``bank``, benchmarks ``bank:NAME``."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sfkit import bank
from sfkit.checkpoints.spec import PoolSpec
from sfkit.datasets import Benchmark
from sfkit.datasets import open_benchmark as open_own_benchmark
from sfkit.errors import InputError, unknown_name
from sfkit.merging import Pool
from sfkit.merging import open_pool as open_own_pool

BANK = "bank"


def open_pool(
    path: str | Path | PoolSpec, *, blocks: Mapping[str, Sequence[str]] | str | None = None
) -> Pool:
    """Open a pool: ``"bank"`` or ``"bank-slim"`` for an embedded one, else a ``pool.toml`` or its folder.

    Args:
        path: which.
        blocks: a partition to use in place of the pool's own: block name -> globs over keys, or how to make
            one, ``"modules"`` or ``"disagreement"``, ``"modules:6"`` for six blocks.

    Raises:
        InputError: as :func:`sfkit.merging.open_pool` says.
    """
    return open_own_pool(bank.pool_path(str(path)) if path in bank.banks() else path, blocks=blocks)


def open_benchmark(
    name: str,
    root: Path | str | None = None,
    *,
    protocol: str | None = None,
    metric: str | None = None,
    resolution: str | None = None,
    pairs: int | Iterable[str] | None = None,
    coding: str | None = None,
    table: Path | str | None = None,
) -> Benchmark:
    """Open a benchmark: ``"bank:NAME"`` of the embedded bank, a public data set, or a folder of pairs.

    Args:
        name: ``bank:NAME``, or what :func:`sfkit.datasets.open_benchmark` takes.
        root: the folder; the bank's benchmarks have none, they are rendered.
        protocol: as there.
        metric: as there.
        resolution: as there.
        pairs: the first so many pairs, or the ids to keep.
        coding: as there.
        table: as there.

    Raises:
        InputError: an unknown name, a root that is missing or not wanted, or settings that do not fit.
    """
    prefix, colon, world = name.partition(":")
    if prefix != BANK:
        if root is None:
            raise InputError(f"benchmark {name!r}: root is missing, expected the folder of its files")
        return open_own_benchmark(
            name,
            root,
            protocol=protocol,
            metric=metric,
            resolution=resolution,
            pairs=pairs,
            coding=coding,
            table=table,
        )
    if not colon:
        known = ", ".join(f"bank:{entry}" for entry in bank.benchmarks())
        raise InputError(f"benchmark {name!r}: the bank has several, expected one of: {known}")
    if root is not None or resolution is not None or coding is not None or table is not None:
        raise InputError(f"benchmark {name!r}: is rendered, expected no root, resolution, coding or table")
    whole = bank.benchmark(world).measured_by(protocol=protocol, metric=metric)
    if pairs is None:
        return whole
    return whole.first(pairs) if isinstance(pairs, int) else whole.select(pairs)


def open_source_data(
    entries: str | Mapping[str, str | Mapping[str, Any]], *, pairs: int = 4
) -> dict[str, Benchmark]:
    """Open what sources were fine-tuned on, for :func:`sfkit.analysis.data_similarity`: source -> pairs.

    Args:
        entries: ``"bank"`` for held-out pairs of the embedded bank's domains; else source name -> entry as
            for :func:`open_benchmarks`.
        pairs: the first so many pairs of each.

    Raises:
        InputError: another word, or as :func:`open_benchmarks` says.
    """
    if isinstance(entries, str):
        if entries != BANK:
            raise InputError(f"source data: found {entries!r}, expected 'bank', or source -> benchmark")
        return {name: bank.held_out(name, pairs) for name in bank.training_seconds()}
    opened = open_benchmarks(entries.values())
    return {source: each.first(pairs) for source, each in zip(entries, opened, strict=True)}


def open_benchmarks(entries: Iterable[str | Mapping[str, Any]]) -> list[Benchmark]:
    """Open several: each entry a name, or the arguments of :func:`open_benchmark` as a dictionary.

    Raises:
        InputError: as :func:`open_benchmark` says, or an entry is neither, or has an unknown argument.
    """
    known = tuple(inspect.signature(open_benchmark).parameters)
    opened = []
    for entry in entries:
        if not isinstance(entry, str | Mapping):
            raise InputError(f"benchmarks: found {entry!r}, expected a name or a dictionary of arguments")
        values = {"name": entry} if isinstance(entry, str) else dict(entry)
        for key in values:
            if key not in known:
                raise unknown_name("argument of a benchmark", key, known)
        if "name" not in values:
            raise InputError(f"benchmarks: found {values}, expected an entry 'name'")
        opened.append(open_benchmark(**values))
    return opened
