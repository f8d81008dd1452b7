"""Pictures to compare by eye: a row a benchmark, its image, then networks of one pool or two (figure 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sfkit.analysis.disparities import DisparityPanels, Network, disparity_panels
from sfkit.datasets.benchmark import Benchmark
from sfkit.errors import InputError
from sfkit.evaluation.compute import HERE, Compute
from sfkit.merging.pool import Pool


def qualitative_grid(
    networks: Sequence[tuple[Pool, Mapping[str, Network]]],
    benchmarks: Sequence[Benchmark],
    *,
    pairs: Mapping[str, str] | None = None,
    compute: Compute = HERE,
) -> tuple[DisparityPanels, ...]:
    """The same networks on one pair of every benchmark, each scored there by the benchmark's own metric.

    Args:
        networks: (pool, column name -> recipe or network of its own), for one pool or several; columns of
            several pools bear the pool's name.
        benchmarks: the rows.
        pairs: benchmark -> id of the pair to show; the first unless given.
        compute: where and how recipes run, in this process.

    Raises:
        InputError: no network or benchmark, two columns of one name, or as
            :func:`~sfkit.analysis.disparities.disparity_panels`.
    """
    if not networks or not benchmarks:
        raise InputError(
            f"pictures: found {len(networks)} pools and {len(benchmarks)} benchmarks, expected some of each"
        )
    several = len(networks) > 1
    named = [
        # Pools have networks of one name, such as uniform.
        (pool, {f"{pool.name}: {name}" if several else name: one for name, one in found.items()})
        for pool, found in networks
    ]
    columns = [name for _, found in named for name in found]
    if len(set(columns)) < len(columns):
        raise InputError(f"pictures: found the columns {columns}, expected a name for each")
    rows = []
    for benchmark in benchmarks:
        pair = (pairs or {}).get(benchmark.name)
        # The first pool's panels bring image and range, the others their networks.
        first, *others = (
            disparity_panels(pool, found, benchmark, pair=pair, compute=compute) for pool, found in named
        )
        together = (*first.networks, *(one for other in others for one in other.networks))
        rows.append(replace(first, networks=together))
    return tuple(rows)
