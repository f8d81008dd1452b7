"""How a pool's sources lie to its base, kept from one ``sfkit show`` to the next: no file is read again.

A pool counts as unchanged while its members, options and blocks are the same, and every file has the size,
times and inode of then. The folder is that of the cached task vectors; ``sfkit cache clear``
empties it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.checkpoints.kinship import Kinship
from sfkit.checkpoints.spec import PoolSpec
from sfkit.errors import InputError
from sfkit.files import default_folder, signature, write_text

FOLDER = "relations"
VERSION = 1  # of what is kept: a change makes old entries unknown
MOST = 200  # pools to remember, a kilobyte each; those seen first go first


@dataclass(frozen=True)
class Relations:
    """How a pool's sources lie to its base.

    Attributes:
        kinships: source -> how near it is.
        blocks: block -> number of elements that any source changed.
    """

    kinships: Mapping[str, Kinship]
    blocks: Mapping[str, int]


def place_of(spec: PoolSpec, blocks: Mapping[str, tuple[str, ...]]) -> Path | None:
    """The file for a pool as it lies there now: its name says everything that the relations follow from.

    None where a member cannot be looked at, which reading it tells, or there is no folder to keep it in.
    """
    try:
        members = [(m.name, str(m.path.absolute()), signature(m.path)) for m in (spec.base, *spec.sources)]
        told = (VERSION, spec.architecture, sorted(spec.options.items()), list(blocks.items()), members)
        return default_folder() / FOLDER / f"{text_digest(json.dumps(told))}.json"
    except (OSError, InputError):
        return None


def recall(spec: PoolSpec, place: Path) -> Relations | None:
    """What was kept of a pool in its file; None where nothing was."""
    try:
        values = json.loads(place.read_text(encoding="utf-8"))
        kinships = {name: Kinship(**values["kinships"][name]) for name in (s.name for s in spec.sources)}
        return Relations(kinships, {str(block): int(size) for block, size in values["blocks"].items()})
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        # Torn, or written by another version: it is worked out anew, and written over.
        return None


def keep(place: Path, found: Relations) -> None:
    """Write it down for the next time; where nothing can be written that one takes as long as this one."""
    kinships = {name: asdict(kinship) for name, kinship in found.kinships.items()}
    # Kept for speed alone: where it cannot be written nothing is lost.
    try:
        write_text(place, json.dumps({"kinships": kinships, "blocks": dict(found.blocks)}), durable=False)
        kept = sorted(place.parent.glob("*.json"), key=lambda path: -path.stat().st_mtime)
        for path in kept[MOST:]:
            path.unlink(missing_ok=True)
    except OSError:
        return
