"""What can be told of pools, benchmarks and networks before anything heavy is imported, to refuse slips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sfkit.architectures.code import imported_files
from sfkit.architectures.names import ensure_architecture
from sfkit.checkpoints.headers import ensure_checkpoint
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.checkpoints.targets import DTYPE_NAMES
from sfkit.cli.options import NAMED, RENDERED, naming, network_options
from sfkit.datasets.root_folder import open_root
from sfkit.datasets.shipped import ensure_data_set
from sfkit.errors import InputError, ensure_known
from sfkit.files import home
from sfkit.merging.blocks import parse_partition
from sfkit.merging.named import named_pool
from sfkit.merging.roster import Roster


def roster_of(path: str, blocks: str | None = None, dtype: str | None = None) -> Roster | None:
    """What the pool says before it is opened; None where code that ``--import`` ran may know it otherwise.

    Raises:
        InputError: an architecture, a data type or a way to make blocks that nobody knows.
    """
    if dtype is not None:
        ensure_known("--dtype", dtype, DTYPE_NAMES)
    if any(imported_files()):
        return None

    def read() -> Roster:
        found = Roster.of(read_pool_spec(named_pool(path) if path in NAMED else path), blocks)
        if blocks is not None:
            parse_partition(blocks)
        return found

    return naming(path, read)


def ensure_benchmark(
    name: str,
    root: str | Path | None = None,
    *,
    protocol: str | None = None,
    metric: str | None = None,
    place: str = "--root",
) -> None:
    """Refuse what can be told of a benchmark by its name and its folder, which ``place`` names.

    Raises:
        InputError: nobody knows the benchmark, its metric or protocol; its folder is not named, or not there.
    """
    from sfkit.datasets.metric import Metric
    from sfkit.datasets.protocols import RULES
    from sfkit.datasets.synthetic.domains import worlds

    collection, colon, world = name.partition(":")
    # What is rendered has no folder.
    if collection not in RENDERED:
        ensure_data_set(name, *(f"{one}:NAME" for one in RENDERED))
        ensure_root(name, root, place)
    elif colon:
        ensure_known("benchmark of the bank", world, worlds())
    if metric is not None:
        Metric.parse(metric)
    if protocol is not None:
        ensure_known("protocol", protocol, RULES)


def ensure_root(name: str, root: str | Path | None, place: str = "--root") -> Path:
    """The folder of a data set, or its table of pairs.

    Raises:
        InputError: it is not named, or not there.
    """
    if root is None:
        raise InputError(f"{place} is missing, expected the folder of benchmark {name!r}")
    return Path(root) if home(root).is_file() else open_root(root)


def ensure_loadable(
    file: Path, architecture: str | None, texts: list[str] | None, *, trained: str | None = None
) -> dict[str, Any]:
    """The architecture's options, after all that can be told of a network before torch is imported.

    ``trained`` is an entry by which a file tells its architecture, too, to those who read it.

    Raises:
        InputError: the file is no checkpoint or does not say its architecture, nobody knows the one that is
            named, or an option cannot be read.
    """
    # What reads checkpoints is no part of a command's help.
    from sfkit.merging.known import ensure_options, nobody_registered, undescribed
    from sfkit.merging.origin import read_origin, stated_texts

    ensure_checkpoint(file)
    options = network_options(texts)
    if architecture is None:
        if trained is not None and trained in stated_texts(file):
            return options
        if (origin := read_origin(file)) is None:
            raise undescribed(file)
        name = str(origin.architecture["name"])
    else:
        name = architecture
        if ":" not in name and nobody_registered():
            naming(file, lambda: ensure_architecture(name))
    naming(file, lambda: ensure_options(name, options))
    return options
