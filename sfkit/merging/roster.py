"""What a pool says of itself before any checkpoint is read, so that mistyped names are refused then."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from sfkit.architectures.names import ensure_architecture
from sfkit.checkpoints.spec import PoolSpec
from sfkit.errors import InputError, ensure_known
from sfkit.merging.known import nobody_registered, partition_of
from sfkit.merging.recipe import Recipe


def sources_of(pool: str, known: Collection[str], names: Iterable[str]) -> tuple[str, ...]:
    """Names, each of which is a source of the pool.

    Raises:
        InputError: a name is none of ``known`` (the nearest is suggested), or stands twice.
    """
    chosen = tuple(names)
    for name in chosen:
        ensure_known(f"source of pool {pool!r}", name, known)
    if len(set(chosen)) != len(chosen):
        raise InputError(f"subset {', '.join(chosen)} names a source twice, expected each once")
    return chosen


@dataclass(frozen=True)
class Roster:
    """Who is in a pool that has not been opened; answers as the pool will, as far as it can tell.

    Attributes:
        name: the pool's.
        names: the sources'.
        blocks: of its partition; None where only its network knows them.
    """

    name: str
    names: tuple[str, ...]
    blocks: tuple[str, ...] | None = None

    @classmethod
    def of(cls, spec: PoolSpec, blocks: str | None = None) -> Roster:
        """What a description tells.

        Args:
            spec: of the pool.
            blocks: how its network is to be divided, see :func:`~sfkit.merging.partitions.auto_partition`.

        Raises:
            InputError: an architecture that comes neither with sfkit nor with an installed package.
        """
        if spec.module is None and ":" not in spec.architecture and nobody_registered():
            ensure_architecture(spec.architecture)
        known = None if blocks or spec.partition else spec.blocks or partition_of(spec)
        return cls(spec.name, tuple(one.name for one in spec.sources), tuple(known) if known else None)

    def subset(self, names: Iterable[str]) -> tuple[str, ...]:
        """As :meth:`Pool.subset <sfkit.merging.pool.Pool.subset>`."""
        return sources_of(self.name, self.names, names)

    def check_recipe(self, recipe: Recipe) -> None:
        """Refuse a recipe of sources that the pool has not.

        Raises:
            InputError: names the source.
        """
        if not recipe.preparation:  # whose steps may make other sources
            self.subset(recipe.sources)
