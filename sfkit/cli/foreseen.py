"""What can be told of pools and networks before torch is imported, so that a slip is refused at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sfkit.architectures.code import imported_files
from sfkit.architectures.names import ensure_architecture
from sfkit.checkpoints.headers import ensure_checkpoint
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.checkpoints.targets import DTYPE_NAMES
from sfkit.cli.options import NAMED, naming, network_options
from sfkit.errors import ensure_known
from sfkit.merging.blocks import parse_partition
from sfkit.merging.known import ensure_options, nobody_registered
from sfkit.merging.named import named_pool
from sfkit.merging.origin import read_origin, stated_texts, undescribed
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


def ensure_loadable(
    file: Path, architecture: str | None, texts: list[str] | None, *, trained: str | None = None
) -> dict[str, Any]:
    """The architecture's options, after all that can be told of a network before torch is imported.

    ``trained`` is an entry by which a file tells its architecture, too, to those who read it.

    Raises:
        InputError: the file is no checkpoint or does not say its architecture, nobody knows the one that is
            named, or an option cannot be read.
    """
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
