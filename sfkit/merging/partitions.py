"""Block partitions made from the network itself, for architectures without one or to compare with theirs.

Two ways, the paper's future work: from the module tree, balanced by how many parameters the sources
changed; and from where task vectors disagree, so that layers that divide the sources alike share a block.
"""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.checkpoints.checks import Kind
from sfkit.errors import InputError, ensure_known
from sfkit.merging.blocks import BLOCKS, WAYS, BlockPartition
from sfkit.merging.pool import Pool
from sfkit.settings import require_whole

_CHUNK = 1 << 20
"""Elements of every task vector that are looked at together: bounds the memory of big pools."""

_ROUNDS = 100
"""Rounds of k-means at most; it ends when no layer changes its block."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Disagreement:
    """How the sources' task vectors lie to each other in one layer.

    Attributes:
        layer: the module's name, as in its keys.
        size: parameters of it that some source changed.
        cosines: (E, E) cosines between task vectors, 0 for a source that left the layer as it is.
        conflict: share in [0, 0.5] of the sources on the smaller side of the sign, mean over parameters.
    """

    layer: str
    size: int
    cosines: Floats
    conflict: float


def auto_partition(pool: Pool, blocks: int = BLOCKS, by: str = "modules") -> BlockPartition:
    """Divide a network into blocks without knowing its architecture.

    ``modules`` cuts the module tree, in the network's order, into runs of about the same number of
    changed parameters: a module above its share is opened up, and the largest run is as small as
    it can be. ``disagreement`` clusters layers by the cosines and sign conflicts of the sources' task
    vectors there (k-means weighted by parameters, begun farthest first, so that no seed is needed);
    layers that no source changed follow the one before.

    Args:
        pool: an open pool; its own partition does not matter.
        blocks: how many, at least 1.
        by: ``modules`` or ``disagreement``.

    Returns:
        Blocks ``part1``, ``part2``, ... in the network's order of their first layer; every parameter
        and running statistic lies in exactly one.

    Raises:
        InputError: another way, or more blocks than there are layers to divide.
    """
    ensure_known("way to partition", by, WAYS)
    require_whole("blocks", blocks, 1)
    groups = _by_modules(pool, blocks) if by == "modules" else _by_disagreement(pool, blocks)
    return BlockPartition.of({f"part{n}": patterns for n, patterns in enumerate(groups, start=1)})


def disagreements(pool: Pool) -> tuple[Disagreement, ...]:
    """How the sources disagree, layer by layer in the network's order; unchanged layers are left out."""
    places: dict[str, list[tuple[int, int]]] = {}
    found = {
        spec.key: (offset, spec.size) for spec, offset in pool.layout.entries if spec.kind is Kind.WEIGHT
    }
    for spec in pool.specs:
        if spec.key in found:
            places.setdefault(_layer(spec.key), []).append(found[spec.key])
    vectors = list(pool.vectors.values())
    return tuple(_disagreement(layer, spans, vectors) for layer, spans in places.items())


def _disagreement(
    layer: str, spans: Sequence[tuple[int, int]], vectors: Sequence[torch.Tensor]
) -> Disagreement:
    gram = torch.zeros(len(vectors), len(vectors), dtype=torch.float64)
    minority, size = 0.0, 0
    for start, length in spans:
        for first in range(start, start + length, _CHUNK):
            last = min(first + _CHUNK, start + length)
            rows = torch.stack([vector[first:last] for vector in vectors])
            # Products in float32 for speed; sums over chunks in float64, which would else lose small ones.
            gram += (rows @ rows.T).double()
            up, down = (rows > 0).sum(dim=0), (rows < 0).sum(dim=0)
            minority += float(torch.minimum(up, down).sum()) / len(vectors)
        size += length
    norms = gram.diagonal().clamp_min(0.0).sqrt()
    # A source that left this layer alone has no direction: its cosines are 0.
    scale = torch.where(norms > 0, 1.0 / norms, 0.0)
    cosines = (gram * scale[:, None] * scale[None, :]).numpy()
    return Disagreement(layer, size, np.asarray(cosines, dtype=np.float64), minority / size)


def _by_modules(pool: Pool, blocks: int) -> list[list[str]]:
    changed = {spec.key: spec.size for spec, _ in pool.layout.entries}
    sizes = {spec.key: changed.get(spec.key, 0) for spec in pool.specs if spec.kind is not Kind.CONSTANT}
    nodes = _children("", sizes)
    share = sum(sizes.values()) / blocks
    while True:
        weights = [_weight(node, sizes) for node in nodes]
        opened = [_opened(node, sizes) for node in nodes]
        # What falls into one piece cannot be opened.
        able = [n for n, inner in enumerate(opened) if len(inner) > 1]
        largest = max(able, key=lambda n: weights[n], default=None)
        if largest is None or (weights[largest] <= share and len(nodes) >= blocks):
            break
        nodes[largest : largest + 1] = opened[largest]
    if len(nodes) < blocks:
        raise InputError(
            f"blocks: found {blocks}, expected at most {len(nodes)}, as many as there are tensors"
        )
    cuts = _cuts([_weight(node, sizes) for node in nodes], blocks)
    runs = [nodes[first:last] for first, last in zip([0, *cuts], [*cuts, len(nodes)], strict=True)]
    return [[_pattern(node, sizes) for node in run] for run in runs]


def _children(prefix: str, sizes: Mapping[str, int]) -> list[str]:
    """The modules right below a prefix, in the network's order; a tensor's key is its own only child."""
    if prefix in sizes:
        return [prefix]
    below = prefix and f"{prefix}."
    names = dict.fromkeys(
        below + key[len(below) :].partition(".")[0] for key in sizes if key.startswith(below)
    )
    return list(names)


def _opened(node: str, sizes: Mapping[str, int]) -> list[str]:
    """What a module falls into: the first modules or tensors below it that are more than one."""
    inner = _children(node, sizes)
    while len(inner) == 1 and inner[0] not in sizes:
        inner = _children(inner[0], sizes)
    return inner


def _weight(node: str, sizes: Mapping[str, int]) -> int:
    return sum(size for key, size in sizes.items() if key == node or key.startswith(f"{node}."))


def _pattern(node: str, sizes: Mapping[str, int]) -> str:
    return glob.escape(node) + ("" if node in sizes else ".*")


def _cuts(weights: Sequence[int], runs: int) -> list[int]:
    """Where to cut a sequence into runs, none empty, so that the heaviest is as light as can be.

    Returns:
        ``runs - 1`` positions; the first run is ``weights[:cuts[0]]``.
    """
    # By dynamic programming: cut greedily at the mean, the last run can be far heavier than it needs to be.
    total = np.concatenate([[0], np.cumsum(weights)])
    count = len(weights)
    best = np.full((runs + 1, count + 1), np.inf)
    back = np.zeros((runs + 1, count + 1), dtype=np.int64)
    best[0, 0] = 0.0
    for run in range(1, runs + 1):
        for end in range(run, count + 1):
            options = np.maximum(best[run - 1, :end], total[end] - total[:end])
            back[run, end] = int(options.argmin())
            best[run, end] = options[back[run, end]]
    cuts, end = [], count
    for run in range(runs, 1, -1):
        end = int(back[run, end])
        cuts.append(end)
    return cuts[::-1]


def _by_disagreement(pool: Pool, blocks: int) -> list[list[str]]:
    found = disagreements(pool)
    if len(found) < blocks:
        raise InputError(
            f"blocks: found {blocks}, expected at most {len(found)}, as many as there are changed layers"
        )
    above = np.triu_indices(len(pool.vectors), k=1)
    features = np.array([[*layer.cosines[above], layer.conflict] for layer in found])
    block_of = dict(
        zip((d.layer for d in found), _clusters(features, [d.size for d in found], blocks), strict=True)
    )
    groups: dict[int, list[str]] = {}
    current = block_of[found[0].layer]
    for spec in pool.specs:
        if spec.kind is Kind.CONSTANT:
            continue
        # A layer that no source changed stays with the one before it.
        current = block_of.get(_layer(spec.key), current)
        groups.setdefault(current, []).append(glob.escape(spec.key))
    return list(groups.values())


def _clusters(points: Floats, weights: Sequence[int], count: int) -> list[int]:
    """Weighted k-means: begins with the heaviest point, then each time the one farthest from all so far."""
    mass = np.asarray(weights, dtype=np.float64)
    chosen = [int(mass.argmax())]
    while len(chosen) < count:
        distance = _distances(points, points[chosen]).min(axis=1)
        # Below 0, so that doubles of a chosen point begin clusters before it would be chosen again.
        distance[chosen] = -1.0
        # Weighted, so that a tiny layer far from all others begins no cluster.
        chosen.append(int((distance * np.sqrt(mass)).argmax()))
    centres = points[chosen].copy()
    labels = np.full(len(points), -1)
    labels[chosen] = range(count)
    for _ in range(_ROUNDS):
        distance = _distances(points, centres)
        fresh = distance.argmin(axis=1)
        for cluster in range(count):  # a cluster that lost all its points takes back the one nearest to it
            if not (fresh == cluster).any():
                spare = [n for n in range(len(points)) if (fresh == fresh[n]).sum() > 1]
                fresh[min(spare, key=lambda n: distance[n, cluster])] = cluster
        if (fresh == labels).all():
            break
        labels = fresh
        for cluster in range(count):
            inside = labels == cluster
            centres[cluster] = np.average(points[inside], axis=0, weights=mass[inside])
    return [int(label) for label in labels]


def _distances(points: Floats, centres: Floats) -> Floats:
    return np.asarray(np.linalg.norm(points[:, None, :] - centres[None, :, :], axis=2))


def _layer(key: str) -> str:
    return key.rpartition(".")[0] or key
