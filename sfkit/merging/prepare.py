"""Pools with prepared task vectors: trimmed, dropped, or made into one; they are pools like any other.

    pool = sfkit.open_pool("pool.toml")
    trimmed = sfkit.prepare(pool, Trim(0.2))                # sources a/trim=0.2, b/trim=0.2, ...
    ties = sfkit.prepare(pool, Trim(0.2), Elect())          # one source: ties

A prepared source has a name and a fingerprint of its own, so that evaluations, searches and recipes never
take it for the one it was made from. A recipe over it carries the steps, from which
:func:`prepared_for` makes the same vectors again, to the last bit, out of the pool as it was read.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from sfkit.checkpoints.fingerprints import tensor_digest, text_digest
from sfkit.errors import InputError, SfkitError
from sfkit.merging.buffers import MAPPED_ABOVE, allocate
from sfkit.merging.cache import VectorCache, VectorRecord
from sfkit.merging.fusion import Importances, fuse
from sfkit.merging.members import ITSELF, Checked
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.merging.sparsity import Piece, Row, Thresholds, pieces, thinned
from sfkit.merging.steps import Elect, FisherMean, Fused, Sparse, Step, Trim, describe, settings

VERSION = 1  # of what the steps compute: a change makes old evaluations and cached vectors unknown


@dataclass(frozen=True)
class _Source:
    """A source on its way: who it is, what it was made from, and how to read it."""

    member: Checked
    origins: tuple[Checked, ...]
    row: Row


def prepare(
    pool: Pool,
    *steps: Step,
    importances: Importances | None = None,
    thresholds: Thresholds | None = None,
    cache: VectorCache | None = None,
) -> Pool:
    """A pool whose task vectors went through ``steps``, in order; the base and the layout stay.

    Vectors are computed piece by piece. Large ones are kept in the cache, where opening and preparing the
    same pool again, here or in a worker, finds them.

    Args:
        pool: base and sources; not changed. May be a prepared one.
        steps: what is done to the task vectors; a :class:`~sfkit.merging.steps.Trim` to density 1 and a
            :class:`~sfkit.merging.steps.Drop` with probability 0 change nothing, names included.
        importances: for :class:`~sfkit.merging.steps.FisherMean`.
        thresholds: those of earlier calls, to be used and added to: they depend on source and density alone.
        cache: where large vectors are kept; the user's cache unless given.

    Raises:
        InputError: a step names sources the pool does not have, would give a new source a name that is
            taken, stands after one that it needs to stand before, or needs importances that are not given.
    """
    # What changes nothing leaves no trace in names and keys.
    # A step that changes nothing leaves the pool what it was, with the scores it has.
    active = tuple(step for step in steps if not (isinstance(step, Sparse) and step.idle))
    if not active:
        return pool
    known = thresholds or Thresholds()
    sources = [_Source(member, pool.origins[member.name], _row(pool, member)) for member in pool.sources]
    for step in active:
        if isinstance(step, Trim):
            # All rows at once, in threads; each step then finds its own ready.
            known.find([source.row for source in sources], step, pool.layout)
        if isinstance(step, Sparse):
            sources = [_thinned(source, step, pool, known) for source in sources]
        else:
            sources = [_fused(sources, step, pool, importances)]
    vectors = {s.member.name: _written(s, pool, cache or VectorCache()) for s in sources}
    return replace(
        pool,
        sources=tuple(source.member for source in sources),
        task_vectors=replace(pool.task_vectors, by_source=vectors),
        preparation=(*pool.preparation, *active),
        origins={source.member.name: source.origins for source in sources},
    )


def prepared_for(pool: Pool, recipe: Recipe, *, importances: Importances | None = None) -> Pool:
    """The pool a recipe is for: ``pool`` itself, or one made from it by the recipe's steps.

    Raises:
        InputError: the pool was prepared otherwise, the steps need what is not there, or the recipe names
            sources they do not make.
    """
    if not recipe.preparation or recipe.preparation == pool.preparation:
        pool.check_recipe(recipe)
        return pool
    if pool.preparation:
        raise InputError(
            f"recipe: merges task vectors after {describe(recipe.preparation)}, expected "
            f"{describe(pool.preparation)} as in this pool: give the pool as it was read"
        )
    made = prepare(pool, *recipe.preparation, importances=importances)
    made.check_recipe(recipe)
    return made


def measured(importances: Importances) -> str:
    """The digest that :class:`~sfkit.merging.steps.FisherMean` knows its importances by."""
    return text_digest(json.dumps({name: tensor_digest(f) for name, f in sorted(importances.items())}))


def _row(pool: Pool, member: Checked) -> Row:
    vector = pool.vectors[member.name]
    return Row(member.fingerprint, lambda piece: vector[piece.start : piece.stop])


def _thinned(source: _Source, step: Sparse, pool: Pool, thresholds: Thresholds) -> _Source:
    identity = _identity(pool, step, [source.row.fingerprint])
    # The first step follows a slash, further ones a comma.
    name = f"{source.member.name}{',' if '/' in source.member.name else '/'}{step.label}"
    member = replace(source.member, name=name, fingerprint=identity)
    return _Source(member, source.origins, thinned(source.row, step, pool.layout, identity, thresholds))


def _fused(sources: Sequence[_Source], step: Fused, pool: Pool, given: Importances | None) -> _Source:
    chosen = _chosen(sources, step, pool)
    origins = {origin.name: origin for source in chosen for origin in source.origins}
    if step.name in pool.identity or step.name in origins:
        raise InputError(f"{step.kind}: the name {step.name!r} is taken by a source, give the step another")
    # Not strict: without weights there are names alone.
    weights = dict(zip(step.sources, step.weights, strict=False)) if isinstance(step, Elect) else {}
    # Sums of floats depend on their order: by content, whatever names and pool.toml say.
    ordered = sorted(chosen, key=lambda source: source.row.fingerprint)
    rows = [source.row for source in ordered]
    own = [weights[source.origins[0].name] for source in ordered] if weights else []
    information = _information(ordered, step, given) if isinstance(step, FisherMean) else []
    identity = _identity(pool, step, [row.fingerprint for row in rows], own)
    licences = dict.fromkeys(origin.licence or "not stated" for origin in origins.values())
    member = Checked(
        step.name,
        Path(f"{step.kind} of {'+'.join(origins)}"),
        identity,
        "; ".join(licences),
        describe([step]),
        pool.base.layout,
        kinship=ITSELF,
    )
    # Made when it is first read: a vector that the cache has is never computed.
    ready: list[torch.Tensor] = []

    def read(piece: Piece) -> torch.Tensor:
        if not ready:
            ready.append(_filled(rows, step, pool, own, information))
        return ready[0][piece.start : piece.stop]

    return _Source(member, tuple(origins.values()), Row(identity, read))


def _filled(
    rows: Sequence[Row],
    step: Fused,
    pool: Pool,
    weights: Sequence[float],
    information: Sequence[torch.Tensor],
) -> torch.Tensor:
    size = pool.layout.size
    out = allocate(size, mapped=size * 4 > MAPPED_ABOVE)
    fuse(step, rows, pool.layout, out, weights=weights, importances=information)
    return out


def _chosen(sources: Sequence[_Source], step: Fused, pool: Pool) -> list[_Source]:
    by_origin = {source.origins[0].name: source for source in sources if len(source.origins) == 1}
    if not step.sources:
        return list(sources)
    for name in step.sources:
        if name not in by_origin:
            known = ", ".join(by_origin) or "none: they were made into one already"
            raise InputError(f"{step.kind}: unknown source {name!r} of pool {pool.name!r}, expected: {known}")
    if len(set(step.sources)) != len(step.sources):
        raise InputError(f"{step.kind}: sources {', '.join(step.sources)} name one twice, expected each once")
    return [by_origin[name] for name in step.sources]


def _information(
    sources: Sequence[_Source], step: FisherMean, given: Importances | None
) -> list[torch.Tensor]:
    if given is None or measured(given) != step.measured:
        raise InputError(
            "fisher: the task vectors were weighted by information measured on images "
            f"({step.on or 'unknown'}), which a recipe does not hold: measure it again with "
            "sfkit.baselines.fisher, or use the merged file"
        )
    return [given[source.origins[0].name] for source in sources]


def _identity(pool: Pool, step: Step, parents: Sequence[str], weights: Sequence[float] = ()) -> str:
    """The fingerprint of what a step makes: by content, so neither names nor the pool's order matter."""
    # Left out: names, and what parents and weights say by their order.
    values = {k: v for k, v in settings(step).items() if k not in ("name", "sources", "weights", "on")}
    content = [f"sfkit-prepared/{VERSION}", pool.base.fingerprint, step.kind, values, list(parents)]
    return text_digest(json.dumps([*content, list(weights)], sort_keys=True))


def _written(source: _Source, pool: Pool, cache: VectorCache) -> torch.Tensor:
    """The vector (P,): from the cache, or computed; large ones are kept there."""
    size = pool.layout.size
    if size * 4 <= MAPPED_ABOVE:
        out = torch.empty(size, dtype=torch.float32)
        _copy(source.row, pool, out)
        return out
    # With offsets: in another layout the same values stand elsewhere.
    order = "\n".join(f"{spec.key} {offset}" for spec, offset in pool.layout.entries)
    key = text_digest(f"prepared\n{source.row.fingerprint}\n{order}")
    known = cache.vector(key)
    if known is None:
        with cache.writing(key, size) as buffer:
            _copy(source.row, pool, buffer)
        # A prepared vector has no kinship: the numbers are those of the base to itself.
        cache.describe(key, VectorRecord(1.0, 0.0, source.member.name))
        known = cache.vector(key)
    if known is None:
        raise SfkitError(f"{cache.folder}: a task vector just cached there is gone, is the disk full?")
    return known[1]


def _copy(row: Row, pool: Pool, out: torch.Tensor) -> None:
    for tensor in pieces(pool.layout):
        for piece in tensor:
            out[piece.start : piece.stop].copy_(row.read(piece))
