"""The pool: one base and its sources, checked for compatibility, their task vectors ready to merge."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import pandas as pd
import torch
from torch import nn

from sfkit.architectures import Architecture
from sfkit.cards import card
from sfkit.checkpoints.checks import TensorSpec
from sfkit.checkpoints.spec import PoolSpec
from sfkit.errors import InputError
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.live import LiveModel
from sfkit.merging.members import Checked, PoolOpener
from sfkit.merging.recipe import Recipe
from sfkit.merging.roster import sources_of
from sfkit.merging.steps import Step, describe
from sfkit.merging.unchanged import ensure_unchanged
from sfkit.merging.vectors import TaskVectors


@dataclass(frozen=True, eq=False, repr=False)
class Pool:
    """Base and sources of one architecture. Open one with :func:`open_pool`.

    Attributes:
        spec: the description it was opened from.
        architecture: the registry's entry.
        options: all its options, defaults filled in.
        partition: the block partition.
        specs: the tensors the network has.
        base: the base checkpoint.
        base_tensors: key -> the base's tensors as read, of which most may be unchanged by any source.
        sources: the sources in the order ``pool.toml`` names them.
        task_vectors: base and sources as flat buffers.
        preparation: what was done to the task vectors after reading; empty for a pool as it was read.
        origins: source name -> the members that source was made from: itself, where it was read.
        dtype: what merged networks are written as, :func:`~sfkit.merging.dtypes.written_as`; None for the
            base's own types.
    """

    spec: PoolSpec
    architecture: Architecture
    options: Mapping[str, Any]
    partition: BlockPartition
    specs: tuple[TensorSpec, ...]
    base: Checked
    base_tensors: Mapping[str, torch.Tensor]
    sources: tuple[Checked, ...]
    task_vectors: TaskVectors
    preparation: tuple[Step, ...] = ()
    origins: Mapping[str, tuple[Checked, ...]] = field(default_factory=dict)
    dtype: str | None = None

    def __post_init__(self) -> None:
        if not self.origins:
            # As it was read, each source is made from itself.
            object.__setattr__(self, "origins", {source.name: (source,) for source in self.sources})

    @property
    def name(self) -> str:
        """The pool's name."""
        return self.spec.name

    @property
    def layout(self) -> FlatLayout:
        """Where each changed tensor lies in the flat buffers."""
        return self.task_vectors.layout

    @property
    def base_flat(self) -> torch.Tensor:
        """(P,) float32, the base's values in that layout."""
        return self.task_vectors.base

    @property
    def vectors(self) -> Mapping[str, torch.Tensor]:
        """Source name -> task vector (P,) float32; do not write to them."""
        return self.task_vectors.by_source

    @cached_property
    def identity(self) -> dict[str, str]:
        """Source name -> fingerprint."""
        return {source.name: source.fingerprint for source in self.sources}

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """One sentence each, for what is allowed and probably not meant."""
        return tuple(_doubts(self))

    @property
    def names(self) -> tuple[str, ...]:
        """The sources' names."""
        return tuple(source.name for source in self.sources)

    @property
    def blocks(self) -> tuple[str, ...]:
        """The block names, in the partition's order."""
        return self.partition.names

    def subset(self, names: Iterable[str]) -> tuple[str, ...]:
        """Check source names.

        Raises:
            InputError: a name is no source of the pool (the nearest is suggested), or stands twice.
        """
        return sources_of(self.name, self.identity, names)

    def equal(self, *names: str) -> Recipe:
        """The equal-weight merge of the named sources."""
        return Recipe.equal(self.subset(names), self.blocks)

    def alone(self) -> dict[str, Recipe]:
        """The base and each source by itself, by name."""
        return {"base": self.base_recipe(), **{name: self.equal(name) for name in self.names}}

    def uniform(self) -> Recipe:
        """The equal-weight merge of all sources."""
        return self.equal(*self.names)

    def base_recipe(self) -> Recipe:
        """The base itself."""
        return Recipe.base(self.blocks)

    def ensure_unchanged(self) -> None:
        """Refuse to go on where a file is no longer what this pool was opened from.

        Raises:
            InputError: names the file.
        """
        read = {m.path: m for members in self.origins.values() for m in members}
        wrappings = {m.name: m.wrapping for m in (self.spec.base, *self.spec.sources)}
        opener = PoolOpener(self.architecture, self.options, self.specs)
        ensure_unchanged((self.base, *read.values()), opener, wrappings, self.name)

    def build(self) -> nn.Module:
        """A network of this architecture, its values not those of any member."""
        return self.architecture.build(**self.options)

    def with_blocks(self, partition: BlockPartition) -> Pool:
        """The same pool under another block partition; no checkpoint is read again.

        Recipes that treat all blocks alike keep their evaluations, since blocks do not matter there.

        Raises:
            InputError: a pattern of the partition matches no parameter.
        """
        partition.check(spec.key for spec in self.specs)
        blocks = dict(zip(partition.names, partition.patterns, strict=True))
        spec = replace(self.spec, blocks=blocks, partition=None)
        return replace(self, spec=spec, partition=partition, task_vectors=self.task_vectors.parted(partition))

    def merge(self, recipe: Recipe, *, device: str = "cpu") -> LiveModel:
        """The network a recipe describes, live: it takes on other recipes in place.

        Raises:
            InputError: the recipe does not suit the pool, or a file of the pool has changed.
        """
        self.ensure_unchanged()
        return LiveModel(self, recipe, device=device)

    def merge_into(self, recipe: Recipe, out: torch.Tensor) -> torch.Tensor:
        """Write the merged flat parameters into ``out`` of shape (P,), and return it.

        Task vectors are added in the order of their fingerprints, so that neither the order of
        ``pool.toml`` nor that of the recipe changes a single bit.

        Raises:
            InputError: the recipe names sources or blocks the pool does not have.
        """
        return self.task_vectors.merge_into(self.ordered(recipe), out)

    def ordered(self, recipe: Recipe) -> Recipe:
        """The recipe with its sources in the order task vectors are added in: that of their fingerprints.

        Raises:
            InputError: the recipe names sources or blocks the pool does not have.
        """
        self.check_recipe(recipe)
        order = sorted(range(len(recipe.sources)), key=lambda e: self.identity[recipe.sources[e]])
        return Recipe(
            tuple(recipe.sources[e] for e in order),
            recipe.blocks,
            tuple(tuple(row[e] for e in order) for row in recipe.weights),
            recipe.scales,
            recipe.preparation,
        )

    def check_recipe(self, recipe: Recipe) -> None:
        """Refuse a recipe that was made for another pool or partition.

        Raises:
            InputError: its sources or blocks are not the pool's, or its task vectors were prepared otherwise.
        """
        if recipe.preparation and recipe.preparation != self.preparation:
            raise InputError(
                f"recipe: merges task vectors after {describe(recipe.preparation)}, those of pool "
                f"{self.name!r} went through {describe(self.preparation) or 'no such step'}: "
                "make its pool with sfkit.prepared_for(pool, recipe)"
            )
        self.subset(recipe.sources)
        self.check_networks(recipe)
        if recipe.blocks != self.blocks:
            raise InputError(
                f"recipe: has the blocks {', '.join(recipe.blocks)}, expected those of pool {self.name!r}: "
                f"{', '.join(self.blocks)}"
            )

    def check_networks(self, recipe: Recipe) -> None:
        """Refuse a recipe where a name stands for another network here than where it was made.

        Raises:
            InputError: names the source, or the base.
        """
        read = {m.name: m for members in self.origins.values() for m in members} | {"base": self.base}
        for name, fingerprint in (recipe.merged_from or {}).items():
            if name in read and read[name].fingerprint != fingerprint:
                known = next((n for n, m in read.items() if m.fingerprint == fingerprint), None)
                other = f"; here {known!r} is, were names exchanged?" if known else ""
                raise InputError(
                    f"recipe: was merged from another {name!r} than that of pool {self.name!r} "
                    f"({read[name].path}), expected the same network{other}; to merge with this one all the "
                    "same, take networks out of its JSON"
                )

    def signed(self, recipe: Recipe) -> Recipe:
        """The recipe with this pool's preparation in it, from which it can be rebuilt later.

        Raises:
            InputError: the recipe is not for this pool.
        """
        self.check_recipe(recipe)
        return replace(recipe, preparation=self.preparation)

    def bound(self, recipe: Recipe) -> Recipe:
        """:meth:`signed`, and bound to this pool's networks: another pool refuses it where a name of its own
        stands for another network.

        Raises:
            InputError: the recipe is not for this pool.
        """
        signed = self.signed(recipe)
        members = {"base": self.base, **self.taking_part(signed)}
        return replace(signed, merged_from={name: m.fingerprint for name, m in members.items()})

    def taking_part(self, recipe: Recipe) -> dict[str, Checked]:
        """The sources with a weight somewhere, or those that one with a weight was made from, by name."""
        weighing = [n for e, n in enumerate(recipe.sources) if any(row[e] for row in recipe.weights)]
        return {origin.name: origin for name in weighing for origin in self.origins[name]}

    def canonical(self, recipe: Recipe) -> dict[str, Any]:
        """What decides the merged network, in content rather than names; part of evaluation keys."""
        self.check_recipe(recipe)
        return recipe.canonical(self.identity, self.partition.fingerprint())

    def state_dict(self, recipe: Recipe) -> dict[str, torch.Tensor]:
        """The merged network's tensors by its keys, of which it has those that the base's file has.

        Each has the data type it has there where that holds the merged values, which were scored in float32,
        to the last bit; else it is float32. In a pool with a :attr:`dtype` each has that. A tensor with
        several keys stands under each, whichever of them the file has. Tensors that no source changed are
        those of the file: do not write to them.

        Raises:
            InputError: the recipe does not suit the pool, a file of the pool has changed, or a merged value
                is beyond the range of its type.
        """
        self.ensure_unchanged()
        merged = self.layout.views(self.merge_into(recipe, torch.empty(self.layout.size)))
        held = {name for spec in self.specs for name in (spec.key, *spec.aliases)}
        return {
            key: _as_precise(key, merged[key], tensor.dtype) if key in merged else tensor
            for key, tensor in self.base_tensors.items()
            # A part that the network is built without is not written.
            if key in held or not self.architecture.is_optional(key)
        }

    def describe(self) -> dict[str, Any]:
        """The architecture with all that changes its output for a recipe; part of evaluation keys."""
        rounding = self.task_vectors.rounding
        # Where code lies on this machine changes no output.
        options = {k: v for k, v in self.options.items() if k not in self.architecture.places}
        return {
            "name": self.architecture.name,
            "version": self.architecture.version_of(self.options),
            # As the store gives it back: tuples are lists there.
            "options": json.loads(json.dumps(options, sort_keys=True)),
            "inputs": self.architecture.inputs(self.options).describe(),
            # Left out where there is none: keys from before pools had a data type stay what they were.
            **({} if rounding is None else {"dtype": self.dtype}),
        }

    def summary(self) -> pd.DataFrame:
        """One row a member: file, licence, nearness to the base, what it lacks."""
        rows = [
            {
                "name": member.name,
                "file": member.path.name,
                "fingerprint": member.fingerprint[:12],
                "licence": member.licence or "not stated",
                "cosine to base": member.kinship.cosine,
                "distance": member.kinship.distance,
                "lacks": len(member.absent),
            }
            for member in (self.base, *self.sources)
        ]
        return pd.DataFrame(rows).set_index("name")

    def _repr_html_(self) -> str:
        members = [("base", self.base), *((source.name, source) for source in self.sources)]
        return card(
            f"Pool {self.name}",
            {
                "architecture": self.architecture.name,
                "blocks": ", ".join(self.blocks),
                "changed parameters": f"{self.layout.size:,}",
                "warnings": len(self.warnings) or "",
            },
            columns=("member", "distance from the base", "licence"),
            rows=[
                (name, f"{member.kinship.distance:.3f}", member.licence or "not stated")
                for name, member in members
            ],
        )

    def __repr__(self) -> str:
        return (
            f"Pool({self.name!r}: {self.architecture.name}, base + {len(self.sources)} sources "
            f"({', '.join(self.names)}), {len(self.blocks)} blocks, {self.layout.size:,} changed parameters)"
        )


def _as_precise(key: str, merged: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    if not bool(torch.isfinite(merged).all()):
        name = str(dtype).removeprefix("torch.")
        raise InputError(
            f"recipe: {key!r} has merged values beyond what {name} holds, expected finite ones: "
            "choose another dtype or smaller weights"
        )
    # There and back: only a type that holds every merged value is taken.
    cast = merged.to(dtype)
    return cast if torch.equal(cast.to(merged.dtype), merged) else merged


def _doubts(pool: Pool) -> Iterable[str]:
    for source in pool.sources:
        if source.fingerprint == pool.base.fingerprint:
            yield f"{source.path}: source {source.name!r} is the base itself, its task vector is zero"
        elif not source.kinship.is_fine_tune:
            yield (
                f"{source.path}: source {source.name!r} does not look like a fine-tune of the base (cosine "
                f"{source.kinship.cosine:.2f}, distance {source.kinship.distance:.2f} of the base's norm; "
                f"a fine-tune has at least {source.kinship.MIN_COSINE} and at most "
                f"{source.kinship.MAX_DISTANCE}): merging it will most likely harm"
            )
        if source.thawed:
            named = ", ".join(source.thawed[:3]) + (", ..." if len(source.thawed) > 3 else "")
            yield (
                f"{source.path}: source {source.name!r} changed {len(source.thawed)} tensors that are frozen "
                f"in fine-tuning ({named}): they are merged like the rest, which costs memory and may harm"
            )
        if source.kept:
            named = ", ".join(source.kept[:3]) + (", ..." if len(source.kept) > 3 else "")
            yield (
                f"{source.path}: source {source.name!r} has other values than the base in {len(source.kept)} "
                f"buffers ({named}), and merges keep the base's: register_architecture(statistics=[...]) says"
                " those to merge like running statistics, constants=[...] those that do not matter"
            )
        if source.absent:
            yield (
                f"{source.path}: source {source.name!r} lacks {len(source.absent)} optional tensors "
                f"({source.absent[0]}, ...): its task vector is zero there and weights are not renormalised"
                f"{pool.architecture.advice_for(source.absent)}"
            )
