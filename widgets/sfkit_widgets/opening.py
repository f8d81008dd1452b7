"""inspect and compare: one call for each view, with what one usually wants."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import sfkit
from sfkit.analysis.disparities import Network
from sfkit.datasets.benchmark import Benchmark
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.pool import Pool
from sfkit_widgets.disparity_compare import DisparityCompare
from sfkit_widgets.routing_inspector import RoutingInspector

BANK, BANK_BENCHMARK = "sfkit-bank", "bank:courtyard"
BANK_PAIRS = 8

PoolLike = Pool | str | os.PathLike[str]


def inspect(
    pool: PoolLike | Evaluator, benchmark: Benchmark | None = None, **settings: Any
) -> RoutingInspector:
    """Edit a routing by hand and see at once what it does.

    Args:
        pool: a pool, what :func:`sfkit.open_pool` opens, or an evaluator, which brings its benchmark.
        benchmark: the pairs to look at and to score on, with or without ground truth; the embedded bank has
            its own unless given.
        settings: as :class:`RoutingInspector` takes them, such as ``subset``, ``search`` or ``pair``.

    Raises:
        InputError: no benchmark for a pool of one's own, two for an evaluator, or as the widget says.
    """
    if isinstance(pool, Evaluator):
        if benchmark is not None:
            raise InputError("benchmark: the evaluator brings one already, give one of the two")
        return RoutingInspector(pool, **settings)
    opened = _opened(pool)
    return RoutingInspector(Evaluator(opened, benchmark or _own(opened)), **settings)


def compare(
    pool: PoolLike,
    networks: Mapping[str, Network] | None = None,
    benchmark: Benchmark | None = None,
    **settings: Any,
) -> DisparityCompare:
    """See networks side by side on one pair.

    Args:
        pool: a pool, or what :func:`sfkit.open_pool` opens.
        networks: name -> recipe or loaded network; the base and the equal merge of all sources unless given.
        benchmark: the pairs, with or without ground truth; the embedded bank has its own unless given.
        settings: as :class:`DisparityCompare` takes them, such as ``shown`` or ``pair``.

    Raises:
        InputError: no benchmark for a pool of one's own, or as the widget says.
    """
    opened = _opened(pool)
    shown = networks or {"base": opened.base_recipe(), "all sources equally": opened.uniform()}
    return DisparityCompare(opened, shown, benchmark or _own(opened), **settings)


def _opened(pool: PoolLike) -> Pool:
    return pool if isinstance(pool, Pool) else sfkit.open_pool(os.fspath(pool))


def _own(pool: Pool) -> Benchmark:
    """Pairs for a pool that came without."""
    if pool.name != BANK:
        raise InputError(
            f"benchmark: found none for pool {pool.name!r}, expected pairs to look at: give "
            "sfkit.open_benchmark(...), or sfkit.open_benchmark('unlabelled', FOLDER) without ground truth"
        )
    return sfkit.open_benchmark(BANK_BENCHMARK, pairs=BANK_PAIRS)
