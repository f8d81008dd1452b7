"""What comes with sfkit, known by keys, shapes and types alone: looking at checkpoints needs no torch then.

Answered here is only what is in every respect as it should be. All else (other types, options
that change tensors, missing parts, values that are not finite, a source unlike its base) is left to
:mod:`sfkit.merging.recognition` and :func:`~sfkit.merging.opening.open_pool`, which say what it is.
``known.json`` is what a test writes, and holds to the networks (``tests/merging/test_merging_known.py``).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfkit.architectures import code
from sfkit.checkpoints.fingerprints import COUNTER, text_digest
from sfkit.checkpoints.headers import TensorPlace
from sfkit.checkpoints.kinship import Kinship, KinshipSums
from sfkit.checkpoints.layouts import Wrapping
from sfkit.checkpoints.spec import PoolSpec
from sfkit.checkpoints.stored import StoredFile, stored_file
from sfkit.errors import InputError, unknown_name
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.kept_relations import Relations, keep, place_of, recall

if TYPE_CHECKING:
    import numpy as np

TABLE = Path(__file__).with_name("known.json")
SHIPPED = "sfkit.architectures."
WEIGHTS = ("torch.float16", "torch.bfloat16", "torch.float32", "torch.float64")
# Options that change no tensor a network cannot be without, and what they may be.
_NEUTRAL: dict[str, Callable[[Any], bool]] = {
    "ranges": lambda v: isinstance(v, list) and len(v) == 3 and all(type(n) is int and n > 0 for n in v),
    "align_corners": lambda v: isinstance(v, bool),
    "spn": lambda v: isinstance(v, bool),
}


@dataclass(frozen=True)
class KnownArchitecture:
    """An architecture with its default options.

    Attributes:
        required: digest of the tensors it cannot be without.
        whole: digest of all its tensors.
        optional: globs of keys that a checkpoint may lack.
        constants: keys that merges copy from the base.
        options: names of its options.
        blocks: block -> globs; empty where checkpoints may be named or laid out in more than one way.
    """

    required: str
    whole: str
    optional: tuple[str, ...]
    constants: tuple[str, ...]
    options: tuple[str, ...]
    blocks: Mapping[str, tuple[str, ...]]


@cache
def table() -> dict[str, KnownArchitecture]:
    """Architecture -> what is known of it."""
    entries = json.loads(TABLE.read_text(encoding="utf-8"))
    return {
        name: KnownArchitecture(
            required=entry["required"],
            whole=entry["whole"],
            optional=tuple(entry["optional"]),
            constants=tuple(entry["constants"]),
            options=tuple(entry["options"]),
            blocks={block: tuple(globs) for block, globs in entry["blocks"].items()},
        )
        for name, entry in entries.items()
    }


def known_file(path: Path) -> tuple[StoredFile, str] | None:
    """A checkpoint, and the shipped architecture that it fits in every key, shape and type.

    None for a file that is not so plain, and where the registry is in use, which may have others.

    Raises:
        InputError: the file cannot be read.
    """
    stored = stored_file(path) if nobody_registered() else None
    name = architecture_of(stored.places) if stored else None
    return (stored, name) if stored and name else None


def undescribed(path: Path) -> InputError:
    """The error for a network that does not say what it is, where nobody else does; its keys may tell."""
    found = known_file(path)
    name = found[1] if found else "NAME"
    return InputError(f"{path}: does not say its architecture, name it (--architecture {name})")


def architecture_of(tensors: Mapping[str, TensorPlace]) -> str | None:
    """The same of a file's tensors by their bare keys."""
    if not nobody_registered():
        return None
    found = _digest({key: tensor.shape for key, tensor in tensors.items()})
    fitting = [
        name
        for name, entry in table().items()
        # With all optional parts or with none: a file with some of them is for torch to look at.
        if found == (entry.whole if any(_any(key, entry.optional) for key in tensors) else entry.required)
        and all(
            tensor.dtype in WEIGHTS
            for key, tensor in tensors.items()
            if key not in entry.constants and not key.endswith(COUNTER)
        )
    ]
    # Where two fit alike, keys tell nothing.
    return fitting[0] if len(fitting) == 1 else None


def nobody_registered() -> bool:
    """Whether there can be no architectures but those that come with sfkit."""
    known = "sfkit.architectures.registry" in sys.modules or any(code.imported_files())
    return not known and not _declared(tuple(sys.path))


@cache
def _declared(places: tuple[str, ...]) -> bool:
    """Whether an installed package declares an architecture: asked once, it takes as long as a small file."""
    return bool(code.declared_names())


def matrices(path: Path) -> dict[str, np.ndarray] | None:
    """Key -> matrix or kernel of a :func:`known_file`; None for others and types that numpy lacks."""
    known = known_file(path)
    arrays = known[0].arrays() if known else None
    if arrays is None:
        return None
    return {key: a for key, a in arrays.items() if a.ndim >= 2 and a.dtype.kind == "f"}


def relations(spec: PoolSpec) -> Relations | None:
    """Kinships and blocks of a pool in which nothing is unusual; None for every other.

    They are kept: asked again, no file is read.

    Raises:
        InputError: a file cannot be read.
    """
    entry = table().get(spec.architecture)
    if entry is None or spec.blocks or spec.partition or partition_of(spec) is None:
        return None
    if any(member.wrapping not in (None, Wrapping()) for member in (spec.base, *spec.sources)):
        return None
    place = place_of(spec, entry.blocks)
    found = recall(spec, place) if place else None
    if found is None:
        found = _relations(spec, entry)
        # A file that was replaced meanwhile would be remembered by what the former one said.
        if found and place and place_of(spec, entry.blocks) == place:
            keep(place, found)
    return found


def _relations(spec: PoolSpec, entry: KnownArchitecture) -> Relations | None:
    """The same from the files."""
    members = (spec.base, *spec.sources)
    base_file = known_file(spec.base.path)
    whole = base_file is not None and any(_any(key, entry.optional) for key in base_file[0].places)
    if whole and spec.options:  # one may leave optional parts out
        return None
    sound = {
        m.name: found for m in members if (found := _sound(m.path, spec.architecture, entry, whole=whole))
    }
    contents = {b"".join(array.tobytes() for array in arrays.values()) for arrays in sound.values()}
    if len(contents) < len(members):  # one is not sound, or two are the same
        return None
    base = sound.pop(spec.base.name)
    kinships = {name: _kinship(base, arrays) for name, arrays in sound.items()}
    if not all(kinship.is_fine_tune for kinship in kinships.values()):
        return None
    partition = BlockPartition.of(entry.blocks)
    sizes = dict.fromkeys(partition.names, 0)
    for key, theirs in base.items():
        block = partition.block_of(key)
        # By bytes, as digests compare: 0.0 and -0.0 differ there.
        if block >= 0 and any(arrays[key].tobytes() != theirs.tobytes() for arrays in sound.values()):
            sizes[partition.names[block]] += theirs.size
    return Relations(kinships, sizes)


def ensure_options(name: str, given: Iterable[str]) -> None:
    """Refuse options that an architecture which is known here does not have; of others nothing is said.

    Raises:
        InputError: as :meth:`Architecture.resolve <sfkit.architectures.registry.Architecture.resolve>`.
    """
    if name in table() and nobody_registered():
        for key in given:
            if key not in table()[name].options:
                raise unknown_name(f"option of architecture {name!r}", key, table()[name].options)


def partition_of(spec: PoolSpec) -> Mapping[str, tuple[str, ...]] | None:
    """Block -> globs, as the architecture that comes with sfkit has them; None where options may matter."""
    entry = table().get(spec.architecture)
    if entry is None or not entry.blocks or spec.module or not nobody_registered():
        return None
    told = spec.options.items()
    plain = all(name in entry.options and name in _NEUTRAL and _NEUTRAL[name](v) for name, v in told)
    return entry.blocks if plain else None


def _sound(
    path: Path, architecture: str, entry: KnownArchitecture, *, whole: bool
) -> dict[str, np.ndarray] | None:
    """Key -> what a pool merges of a file, all of it finite and no variance below 0; None for other files.

    ``whole`` files have the optional parts, others have none of them.
    """
    import numpy as np

    known = known_file(path)
    arrays = known[0].arrays() if known and known[1] == architecture else None
    if arrays is None or any(_any(key, entry.optional) for key in arrays) != whole:
        return None
    # In one order, so that whole contents of files compare.
    kept = {key: arrays[key] for key in sorted(arrays) if not key.endswith(COUNTER)}
    for key, array in kept.items():
        if not np.isfinite(array).all() or (key.endswith(".running_var") and (array < 0).any()):
            return None
    return kept


def _kinship(base: Mapping[str, np.ndarray], source: Mapping[str, np.ndarray]) -> Kinship:
    sums = KinshipSums()
    for key, theirs in base.items():
        statistic = key.rpartition(".")[2] in ("running_mean", "running_var")
        if source[key].tobytes() != theirs.tobytes() and not statistic:
            sums.add_arrays(theirs, source[key])
    return sums.kinship()


def _digest(shapes: Mapping[str, tuple[int, ...]]) -> str:
    kept = sorted(f"{key} {tuple(shape)}" for key, shape in shapes.items() if not key.endswith(COUNTER))
    return text_digest("\n".join(kept))


def _any(key: str, globs: tuple[str, ...]) -> bool:
    return any(fnmatchcase(key, glob) for glob in globs)
