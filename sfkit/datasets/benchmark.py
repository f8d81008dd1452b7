"""Open benchmarks: a public data set, a folder of pairs of one's own, or samples in memory."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.census import CENSUS
from sfkit.datasets.folders import find_in_folders, nothing_recognised
from sfkit.datasets.listing import PairListing, find_pairs, nothing_found, warn_of_incomplete
from sfkit.datasets.manifests import load_manifest
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import MemoryPair, Pair, Sample
from sfkit.datasets.protocols import DEFAULT_PROTOCOL, PAIRS_PROTOCOL, default_metric, rule
from sfkit.datasets.root_folder import open_root
from sfkit.datasets.shipped import PAIRS, UNLABELLED
from sfkit.datasets.tables import absent_files, find_in_table
from sfkit.datasets.unlabelled import find_unlabelled
from sfkit.errors import InputError, ensure_known
from sfkit.files import home

PAIRS_METRIC = "epe"


@dataclass(frozen=True)
class _Rendered:
    """Benchmarks without files, and what makes one of them."""

    names: tuple[str, ...]
    make: Callable[[str], Benchmark]


SHIPPED = "sfkit.bank.shipped"  # stands further right, and is imported when a name is looked up
_RENDERED: dict[str, _Rendered] = {}


def register_benchmarks(collection: str, names: Iterable[str], make: Callable[[str], Benchmark]) -> None:
    """Let :func:`open_benchmark` know benchmarks without files as ``COLLECTION:NAME``."""
    _RENDERED[collection] = _Rendered(tuple(names), make)


def _has_files(name: str) -> bool:
    """Whether the benchmark of that name lies in a folder."""
    collection = name.partition(":")[0]
    if collection.startswith(SHIPPED.split(".")[1]):  # what it registers is called after it
        importlib.import_module(SHIPPED)
    return collection not in _RENDERED


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
    every: int | None = None,
) -> Benchmark:
    """Find the pairs of a data set under a folder, or those that come with sfkit; no image is read.

    Args:
        name: a manifest's name (``eth3d``, ``kitti2012``, ``kitti2015``, ``middlebury``), ``pairs``
            for a folder of one's own (see :mod:`sfkit.datasets.folders`) or a CSV file, ``unlabelled`` for
            pairs without ground truth (see :mod:`sfkit.datasets.unlabelled`), or ``bank:NAME`` and
            ``bank-sharp:NAME`` of the embedded banks.
        root: the folder; for ``pairs`` and ``unlabelled`` also a CSV file, whose paths are then relative
            to its folder; none for the bank's, which are rendered.
        protocol: ``openstereo`` unless given; ``all-valid`` for ``pairs``.
        metric: the protocol's or the data set's own unless given; ``epe`` for ``pairs``, ``census`` for
            ``unlabelled``, which takes no metric that needs ground truth.
        resolution: ``F``, ``H`` or ``Q`` of Middlebury; one that the protocol allows unless given.
        pairs: the first so many pairs, or the ids to keep.
        coding: how the ground truth of ``pairs`` is coded, where its suffix does not settle it.
        table: a CSV file that lies elsewhere than ``root``.
        every: of ``unlabelled`` video, every so many pairs of each folder.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where pairs are incomplete and left out, naming them.

    Raises:
        InputError: an unknown name, no complete pair, ambiguous or misplaced files, or settings that do
            not fit each other; the message says what to do.
    """
    if every is not None and name != UNLABELLED:
        raise InputError(
            f"{name}: found every={every}, which thins unlabelled video; use pairs=N, or leave it"
        )
    if not _has_files(name):
        rendered = _rendered(name)
        if root is not None or resolution is not None or coding is not None or table is not None:
            raise InputError(
                f"benchmark {name!r}: is rendered, expected no root, resolution, coding or table"
            )
        whole = rendered().measured_by(protocol=protocol, metric=metric)
    elif root is None:
        raise InputError(f"benchmark {name!r}: root is missing, expected the folder of its files")
    elif name == UNLABELLED:
        if resolution is not None or coding is not None:
            raise InputError(
                "unlabelled: found resolution or coding, there is no ground truth; leave them out"
            )
        whole = _open_unlabelled(root, protocol, metric, table, 1 if every is None else every)
    elif name == PAIRS:
        if resolution is not None:
            raise InputError(f"pairs: found resolution={resolution!r}, a folder has none; leave it out")
        whole = _open_pairs(root, protocol, metric, coding, table)
    else:
        if coding is not None or table is not None:
            raise InputError(
                f"{name}: found coding or table, its manifest says both; use 'pairs' or leave them"
            )
        whole = _open_named(name, root, protocol, metric, resolution)
    if pairs is None:
        return whole
    return whole.first(pairs) if isinstance(pairs, int) else whole.select(pairs)


def open_benchmarks(entries: Iterable[str | Mapping[str, Any]]) -> list[Benchmark]:
    """Open several: each entry a name, or the arguments of :func:`open_benchmark` as a dictionary.

    Raises:
        InputError: as :func:`open_benchmark` says, or an entry is neither, or has an unknown argument.
    """
    # From the signature: a new argument is known to every file that names benchmarks.
    known = tuple(inspect.signature(open_benchmark).parameters)
    opened = []
    for entry in entries:
        if not isinstance(entry, str | Mapping):
            raise InputError(f"benchmarks: found {entry!r}, expected a name or a dictionary of arguments")
        values = {"name": entry} if isinstance(entry, str) else dict(entry)
        for key in values:
            ensure_known("argument of a benchmark", key, known)
        if "name" not in values:
            raise InputError(f"benchmarks: found {values}, expected an entry 'name'")
        opened.append(open_benchmark(**values))
    return opened


def _rendered(name: str) -> Callable[[], Benchmark]:
    """What makes a benchmark without files, called ``COLLECTION:NAME``."""
    collection, colon, one = name.partition(":")
    known = _RENDERED[collection]
    if not colon:
        listed = ", ".join(f"{collection}:{entry}" for entry in known.names)
        raise InputError(f"benchmark {name!r}: the {collection} has several, expected one of: {listed}")
    return partial(known.make, one)


def _open_named(
    name: str, root: Path | str, protocol: str | None, metric: str | None, resolution: str | None
) -> Benchmark:
    manifest, folder = load_manifest(name), open_root(root)
    protocol = protocol or DEFAULT_PROTOCOL
    metric = metric or default_metric(protocol, manifest.family, manifest.metric)
    resolution = manifest.resolution(resolution, rule(protocol, manifest.family).resolutions)
    found = find_pairs(manifest, folder, resolution)
    if not found.pairs:
        raise InputError(nothing_found(manifest, folder, resolution, found))
    warn_of_incomplete(name, found)
    return Benchmark(
        name=name,
        family=manifest.family,
        pairs=found.pairs,
        protocol=protocol,
        metric=metric,
        resolution=resolution,
        own_metric=manifest.metric,
        expected=len(manifest.ids),
        root=folder,
        citation=manifest.citation,
        licence=manifest.licence,
        notes=found.notes,
    )


def _open_pairs(
    root: Path | str, protocol: str | None, metric: str | None, coding: str | None, table: Path | str | None
) -> Benchmark:
    protocol = protocol or PAIRS_PROTOCOL
    metric = metric or default_metric(protocol, PAIRS, PAIRS_METRIC)
    folder, found, absent = find_own_pairs(root, coding, table)
    if absent:
        raise InputError(absent)
    if not found.pairs:
        raise InputError(nothing_recognised(folder, found))
    warn_of_incomplete(folder.name, found)
    return _own(folder, found, protocol, metric)


def _open_unlabelled(
    root: Path | str, protocol: str | None, metric: str | None, table: Path | str | None, every: int
) -> Benchmark:
    wanted = Metric.parse(metric or CENSUS)
    if wanted.needs_truth:
        raise InputError(
            f"unlabelled: found the metric {wanted}, which compares with ground truth, and these pairs have "
            "none; use census, or a labelled benchmark"
        )
    folder, found = find_unlabelled(root, table, every)
    return _own(folder, found, protocol or PAIRS_PROTOCOL, wanted.name)


def _own(folder: Path, found: PairListing, protocol: str, metric: str) -> Benchmark:
    return Benchmark(folder.name, PAIRS, found.pairs, protocol, metric, root=folder, notes=found.notes)


def find_own_pairs(
    root: Path | str, coding: str | None = None, table: Path | str | None = None
) -> tuple[Path, PairListing, str]:
    """The root and the pairs of a folder, or of a CSV file (``table``, or ``root`` itself).

    The third value says which files of a table are absent; it is empty where none is.

    Raises:
        InputError: nothing is there, or see :mod:`sfkit.datasets.folders` and :mod:`sfkit.datasets.tables`.
    """
    root = home(root)
    if table is None and root.is_file():
        table, root = root, root.parent
    folder = open_root(root)
    if table is None:
        return folder, find_in_folders(folder, coding), ""
    table = home(table)
    found = find_in_table(table, folder, coding)
    return folder, found, absent_files(table, folder, found)


def memory_benchmark(
    name: str,
    pairs: Iterable[Pair | Sample],
    *,
    family: str = "pairs",
    protocol: str = PAIRS_PROTOCOL,
    metric: str | None = None,
    citation: str = "",
    licence: str = "",
    notes: Iterable[str] = (),
) -> Benchmark:
    """A benchmark of samples held in memory, such as rendered ones.

    Raises:
        InputError: no pair, an id twice, an unknown protocol or metric.
    """
    return Benchmark(
        name=name,
        family=family,
        pairs=tuple(MemoryPair(p.id, p) if isinstance(p, Sample) else p for p in pairs),
        protocol=protocol,
        metric=metric or default_metric(protocol, family, PAIRS_METRIC),
        citation=citation,
        licence=licence,
        notes=tuple(notes),
    )
