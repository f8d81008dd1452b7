"""What a checkpoint is, from its keys; which of several is the base of the others, from their distances."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from sfkit.checkpoints.headers import is_checkpoint_name
from sfkit.checkpoints.spec import ROWS
from sfkit.errors import InputError, SfkitWarning, unknown_name
from sfkit.merging.known import known_file, matrices
from sfkit.outside import is_text, toml_value

if TYPE_CHECKING:
    import numpy as np

BASES = ("base", "pretrain", "sceneflow", "scene_flow")
"""Words in the names of files that others were fine-tuned from."""
ALIKE = 1.1  # distances that differ less may be either's


@dataclass(frozen=True)
class CheckpointFamily:
    """Checkpoints of one architecture in a folder.

    Attributes:
        architecture: its name, recognised by the keys.
        base: the guess of what all were fine-tuned from: even the farthest other is near to it.
        sources: the other files.
        distances: file -> distance to the farthest of the others, as a share of its norm.
        cosines: file -> cosine of its weights to the base's.
        skipped: file -> why it is no member.
    """

    architecture: str
    base: Path
    sources: tuple[Path, ...]
    distances: Mapping[Path, float]
    cosines: Mapping[Path, float]
    skipped: Mapping[Path, str]


def recognised(path: Path) -> tuple[str, ...]:
    """The architectures, with their default options, that a checkpoint's keys and shapes fit.

    Raises:
        InputError: the file cannot be read.
    """
    if known := known_file(path):
        return (known[1],)
    from sfkit.architectures import architecture, architectures
    from sfkit.architectures.code import FAILURES
    from sfkit.checkpoints.reading import read_checkpoint
    from sfkit.merging.members import PoolOpener
    from sfkit.merging.tensor_specs import tensor_specs

    # What cannot be read fits nothing, and says why here.
    read_checkpoint(path)
    fitting = []
    for name in architectures():
        try:
            entry = architecture(name)
        except InputError as error:  # of a package that cannot be imported: others have nothing to do with it
            warnings.warn(str(error), SfkitWarning, stacklevel=2)
            continue
        if entry.places:  # built from a checkout that nobody has named
            continue
        try:
            options = entry.resolve(near=path)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SfkitWarning)  # said again where it is opened
                PoolOpener(entry, options, tensor_specs(entry, options)).read(path, is_base=False)
        except InputError:
            continue
        except FAILURES as error:  # whatever another's code does when it is built with its defaults
            reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
            warnings.warn(
                f"architecture {name!r}: cannot be built with its default options ({reason}), so its keys "
                "are not known",
                SfkitWarning,
                stacklevel=2,
            )
            continue
        fitting.append(name)
    return tuple(fitting)


def whose_keys(path: Path, name: str) -> str:
    """Whose keys a file has that does not fit an architecture, after a semicolon, for the end of a sentence.

    Nothing where they are that one's after all, or of nothing that is known.
    """
    try:
        others = recognised(path)
    except InputError:  # it cannot be read at all, which has been said
        return ""
    if not others or name in others:
        return ""
    return f"; its keys are those of {' or '.join(others)}: is architecture = {name!r} what you meant?"


def family(folder: Path, base: str | None = None) -> CheckpointFamily:
    """The checkpoints of a folder as a pool: one architecture, a base, and sources.

    Args:
        folder: of checkpoints.
        base: the base's file name; guessed unless given.

    Raises:
        InputError: no folder, fewer than two checkpoints, none whose architecture is known, or no ``base``
            among them.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder, expected one of checkpoints")
    files = sorted(path for path in folder.iterdir() if path.is_file() and is_checkpoint_name(path))
    if len(files) < 2:
        raise InputError(f"{folder}: found {len(files)} checkpoints, expected a base and at least one source")
    kinds: dict[Path, tuple[str, ...]] = {}
    skipped: dict[Path, str] = {}
    for path in files:
        if not is_text(str(path)):
            skipped[path] = f"{path.stem!r}: has a name that is no UTF-8, which no TOML can hold"
            continue
        try:
            kinds[path] = recognised(path)
        except InputError as error:
            skipped[path] = str(error)
            continue
        if not kinds[path]:
            skipped[path] = f"{path}: fits no architecture sfkit knows"
    counts = Counter(name for found in kinds.values() for name in found)
    # The architecture of most files, of equals the first by name.
    name = min(counts, key=lambda candidate: (-counts[candidate], candidate), default="")
    members = [path for path, found in kinds.items() if name in found]
    if len(members) < 2:
        raise InputError(
            f"{folder}: found {len(members)} checkpoints of one known architecture, expected two or more: "
            "name your own with --import FILE, or write pool.toml by hand"
        )
    skipped |= {p: f"{p}: fits {', '.join(f)}, not {name}" for p, f in kinds.items() if f and name not in f}
    if base is not None and base not in {path.name for path in members}:
        raise unknown_name("--base", base, [path.name for path in members])
    return _family(name, members, skipped, base)


def _family(
    name: str, members: Sequence[Path], skipped: Mapping[Path, str], stated: str | None
) -> CheckpointFamily:
    import numpy as np

    weights = {path: _matrices(path, name) for path in members}
    keys = [key for key in weights[members[0]] if all(key in held for held in weights.values())]
    flat = {p: np.concatenate([held[key].reshape(-1) for key in keys]) for p, held in weights.items()}
    # In float64: a fine-tune's distance is a small difference.
    flat = {path: vector.astype(float) for path, vector in flat.items()}
    norms = {path: float(np.linalg.norm(vector)) for path, vector in flat.items()}
    apart = {
        frozenset(pair): float(np.linalg.norm(flat[pair[0]] - flat[pair[1]]))
        for pair in combinations(members, 2)
    }
    farthest = {p: max(apart[frozenset((p, o))] for o in members if o != p) / norms[p] for p in members}
    # Fine-tunes of fine-tunes lie in clusters, which a mean distance would follow: the largest one does not.
    near = [p for p in members if farthest[p] <= ALIKE * min(farthest.values())]
    named = [path for path in near if any(word in path.stem.lower() for word in BASES)]
    # A base and a fine-tune of which there are further ones may lie alike: then a name says more.
    base = min(named or near, key=lambda path: farthest[path])
    base = next((path for path in members if path.name == stated), base)
    cosines = {p: float(flat[p] @ flat[base]) / (norms[p] * norms[base]) for p in members}
    return CheckpointFamily(name, base, tuple(p for p in members if p != base), farthest, cosines, skipped)


def _matrices(path: Path, name: str) -> Mapping[str, np.ndarray]:
    """Key as the network has it -> each matrix and kernel of a checkpoint of the architecture ``name``."""
    plain = matrices(path)
    if plain is not None:
        return plain
    import torch

    from sfkit.architectures import architecture
    from sfkit.merging.members import PoolOpener
    from sfkit.merging.tensor_specs import tensor_specs

    entry = architecture(name)
    options = entry.resolve(near=path)
    # As a source, which may lack optional parts.
    tensors = PoolOpener(entry, options, tensor_specs(entry, options)).read(path, is_base=False).tensors
    kept = {key: t for key, t in tensors.items() if t.ndim >= 2 and t.is_floating_point()}
    # numpy has no bfloat16.
    return {key: (t.float() if t.dtype == torch.bfloat16 else t).numpy() for key, t in kept.items()}


def pool_toml(found: CheckpointFamily, name: str) -> str:
    """A commented ``pool.toml`` for a family, to lie in its folder."""
    lines = [
        f"name = {toml_value(name)}",
        f'architecture = "{found.architecture}"    # recognised by the keys',
        "",
        f"# Guessed: even the farthest other is near ({found.distances[found.base]:.3f} of its norm).",
        "[base]",
        f"file = {toml_value(found.base.name)}",
        '# licence = "..."    # fill in: it is carried into every merged file',
    ]
    for path, key in zip(found.sources, _names(found.sources), strict=True):
        lines += ["", f"[sources.{key}]    # cosine to the base {found.cosines[path]:.3f}"]
        lines += [f"file = {toml_value(path.name)}", '# licence = "..."    # and what it was trained on']
    lines += [f"\n# left out: {toml_value(' '.join(why.split()))[1:-1]}" for why in found.skipped.values()]
    return "\n".join(lines) + "\n"


def _names(paths: Sequence[Path]) -> list[str]:
    """File names as source names: letters, digits and ``_ . -``, each once."""
    names: list[str] = []
    for path in paths:
        stem = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in path.stem).strip(
            "_-"
        )
        name, number = stem or "source", 2
        # Tables call other rows by these names.
        while name in (*names, *ROWS):
            name, number = f"{stem}_{number}", number + 1
        names.append(name)
    return names
