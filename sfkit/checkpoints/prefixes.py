"""The prefix of a training class (``model.``, ``net.``), told from the names the network's own tensors have.

A Lightning module or a trainer saves ``model.encoder.weight`` beside ``loss.vgg.weight``: the network is what
lies under the one prefix that makes its keys complete.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import torch

from sfkit.errors import InputError

Rename = Callable[[Iterable[str]], Mapping[str, str]]
DEPTH = 4  # names a prefix may consist of: module.model.net.core.


def network_prefix(
    path: Path,
    tensors: Mapping[str, torch.Tensor],
    required: Iterable[str],
    rename: Rename | None = None,
    given: str | None = None,
) -> str:
    """What stands before the network's keys in a file; the empty string where nothing does, or none fits.

    Args:
        path: named in errors.
        tensors: the file's, by their keys.
        required: keys the network cannot be without.
        rename: keys as found -> as the network names them, applied to what is left behind the prefix.
        given: the prefix ``pool.toml`` gives.

    Raises:
        InputError: no key begins with the prefix that was given, several prefixes fit, or only most of the
            network lies under one.
    """
    if given is not None:
        if not any(key.startswith(given) for key in tensors):
            raise InputError(
                f"{path}: no key begins with {given!r} (prefix in pool.toml), found {next(iter(tensors))!r} "
                f"and {len(tensors) - 1} more"
            )
        return given
    needed = set(required)
    if needed <= _names(tensors, "", rename):
        return ""
    fitting = [p for p in _candidates(tensors, len(needed)) if needed <= _names(tensors, p, rename)]
    if len(fitting) > 1:
        raise InputError(
            f"{path}: holds the whole network under the prefixes {' and '.join(map(repr, fitting))}, "
            'expected one: say which with prefix = "..." in pool.toml'
        )
    if fitting:
        return fitting[0]
    found = {p: needed & _names(tensors, p, rename) for p in ("", *_candidates(tensors, 1))}
    # Of prefixes with as many keys the shortest: the longer ones lie below it.
    best = max(found, key=lambda p: (len(found[p]), -len(p)))
    # Less than half could be chance.
    if best and 2 * len(found[best]) > len(needed):
        raise InputError(
            f"{path}: under the prefix {best!r} lie {len(found[best])} of the {len(needed)} tensors the "
            f"architecture needs, {min(needed - found[best])!r} is missing: is this a checkpoint of another "
            "architecture or with other options?"
        )
    return ""


def _names(tensors: Mapping[str, torch.Tensor], prefix: str, rename: Rename | None) -> set[str]:
    bare = [key[len(prefix) :] for key in tensors if key.startswith(prefix)]
    return set(bare) if rename is None else {rename(bare).get(key, key) for key in bare}


def _candidates(tensors: Mapping[str, torch.Tensor], least: int) -> list[str]:
    """Prefixes that at least so many keys have, shorter ones first."""
    counts: Counter[str] = Counter()
    for key in tensors:
        parts = key.split(".")
        # The last part is the tensor's own name.
        counts.update(".".join(parts[:depth]) + "." for depth in range(1, min(DEPTH + 1, len(parts))))
    return sorted((p for p, count in counts.items() if count >= least), key=lambda p: (p.count("."), p))
