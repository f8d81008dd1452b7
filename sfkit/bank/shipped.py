"""What ships of the banks beside their networks: benchmarks, how trainings went, what sources saw."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sfkit.bank.plan import BANK, BANKS, bank_plan, banks
from sfkit.bank.rendered import benchmark, benchmarks, held_out
from sfkit.bank.sharp import JOINT
from sfkit.datasets.benchmark import open_benchmarks, register_benchmarks
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.synthetic.domains import BASE, VALIDATION
from sfkit.errors import InputError


def pool_path(name: str = BANK.name) -> Path:
    """The ``pool.toml`` of a bank that ships with sfkit; base and sources lie beside it.

    Raises:
        InputError: no bank of that name.
    """
    return bank_plan(name).pool_file


def joint_path(name: str) -> Path:
    """The network of a bank that was trained on all sources' scenes together.

    Raises:
        InputError: no bank of that name, or no such network ships with it.
    """
    path = pool_path(name).with_name(f"{JOINT}.safetensors")
    if not path.exists():
        how = f": sfkit bank build {name} trains it" if bank_plan(name).joint else ""
        raise InputError(f"joint: no joint network ships with {name!r}, expected a bank that has one{how}")
    return path


def trainings(name: str = BANK.name) -> dict[str, dict[str, Any]]:
    """Network -> how its training went, as recorded: plan, wall and CPU seconds, errors.

    Raises:
        InputError: no bank of that name.
    """
    record = pool_path(name).with_name("trainings.json").read_text(encoding="utf-8")
    return dict(json.loads(record))


def training_seconds(name: str = BANK.name, *, cpu: bool = False) -> dict[str, float]:
    """Source -> wall or CPU seconds of the one thread that fine-tuned it, recorded when the bank was built.

    They stand beside those of searches. The machine did other work at the time: the CPU seconds are a quarter
    of the wall seconds on ``bank`` and half on ``bank-sharp``, so that the overhead of a
    search on an idle machine against the latter is a lower bound.

    Raises:
        InputError: no bank of that name.
    """
    records = trainings(name).items()
    key = "cpu_seconds" if cpu else "seconds"
    return {source: float(r[key]) for source, r in records if source not in (BASE.name, JOINT)}


def joint_training(name: str = BANK.name, *, cpu: bool = False) -> tuple[Path, float] | tuple[None, None]:
    """A bank's network that was trained on all sources' scenes, and its wall or CPU seconds; else None twice.

    As :func:`training_seconds`, on a machine that did other work: the CPU seconds are a third of these.

    Raises:
        InputError: no bank of that name.
    """
    record, path = trainings(name).get(JOINT), pool_path(name).with_name(f"{JOINT}.safetensors")
    key = "cpu_seconds" if cpu else "seconds"
    return (path, float(record[key])) if record and path.exists() else (None, None)


def worlds(
    pool: object,
    benchmark: str | None,
    report_on: Sequence[str | Mapping[str, Any]] | None = None,
    *,
    guide: str = VALIDATION,
) -> tuple[str, list[str | Mapping[str, Any]]]:
    """What guides and what tests a pool: what is named, and for the bank's own pools its worlds by default.

    Args:
        pool: a bank's name, or what :func:`sfkit.open_pool` takes besides.
        benchmark: what guides; None where nothing was named.
        report_on: what tests; None where nothing was named: all worlds but ``guide``.
        guide: the world that guides by default.

    Raises:
        InputError: a pool of one's own and no benchmark: rendered worlds say nothing of it.
    """
    own = pool not in banks()
    if benchmark is None and own:
        raise InputError(
            f"benchmark is missing: pool {str(pool)!r} is none of the bank's ({', '.join(banks())}), whose "
            "rendered worlds would say nothing of it; name what guides the search, such as eth3d with "
            "benchmark_root ~/ETH3D, and in report_on what tests it"
        )
    collection = BANK.name if own else bank_plan(str(pool)).benchmarks
    # Worlds that the bank's plan renders test its pools alone.
    unseen = () if own else (f"{collection}:{name}" for name in benchmarks() if name != guide)
    tests: list[str | Mapping[str, Any]] = [*(unseen if report_on is None else report_on)]
    return benchmark or f"{collection}:{guide}", tests


for _name in sorted({plan.benchmarks for plan in BANKS.values()}):
    register_benchmarks(_name, benchmarks(), partial(benchmark, of=_name))


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
        if entries not in banks():
            raise InputError(
                f"source data: found {entries!r}, expected {' or '.join(map(repr, banks()))}, or "
                "source -> benchmark"
            )
        return {name: held_out(name, pairs, of=entries) for name in training_seconds(entries)}
    opened = open_benchmarks(entries.values())
    return {source: each.first(pairs) for source, each in zip(entries, opened, strict=True)}
