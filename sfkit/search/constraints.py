"""What a search may propose: sources in or out, the largest subset, frozen blocks; and subset transfer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe
from sfkit.search.checks import distinct_names, require_known
from sfkit.search.operators import SMALLEST, SubsetSpace
from sfkit.settings import setting, settle, whole


@dataclass(frozen=True)
class Constraints:
    """Limits both stages respect; the same record can be given to both.

    Attributes:
        include: sources that must take part.
        exclude: sources that must not take part.
        largest: the most sources a subset may have, None for no limit. The smallest size is always 2.
        frozen_blocks: blocks whose scale stays 1 and is no dimension of Stage 2; with block-specific
            routing their weights stay equal as well. Stage 1's merges have equal weights and scales of 1,
            so that it satisfies them as it is.
    """

    include: tuple[str, ...] = setting((), help="Sources that must take part: a,b.", check=distinct_names)
    exclude: tuple[str, ...] = setting((), help="Sources that must not take part: a,b.", check=distinct_names)
    largest: int | None = setting(None, help="The most sources a subset may have.", check=whole(SMALLEST))
    frozen_blocks: tuple[str, ...] = setting(
        (), "--frozen", help="Blocks whose scale stays 1: a,b.", check=distinct_names
    )

    def __post_init__(self) -> None:
        settle(self)
        for name in self.include:
            if name in self.exclude:
                raise InputError(f"include: {name!r} is also in exclude, expected it in one of the two")
        if self.largest is not None and self.largest < len(self.include):
            raise InputError(
                f"largest: found {self.largest}, expected at least {len(self.include)}, the number of "
                "sources in include"
            )

    def space(self, sources: tuple[str, ...], blocks: tuple[str, ...]) -> SubsetSpace:
        """The chromosomes of Stage 1: indices into ``sources``.

        Raises:
            InputError: a name that is neither source nor block, or fewer than two sources left.
        """
        require_known("include", self.include, sources, "source")
        require_known("exclude", self.exclude, sources, "source")
        require_known("frozen_blocks", self.frozen_blocks, blocks, "block")
        allowed = tuple(i for i, name in enumerate(sources) if name not in self.exclude)
        if len(allowed) < SMALLEST:
            raise InputError(
                f"sources: found {len(allowed)} that may take part ({len(self.exclude)} excluded), "
                f"expected at least {SMALLEST}: there is nothing to choose from"
            )
        required = frozenset(sources.index(name) for name in self.include)
        largest = len(allowed) if self.largest is None else min(self.largest, len(allowed))
        return SubsetSpace(allowed, required, largest)

    def check_subset(self, subset: tuple[str, ...], blocks: tuple[str, ...]) -> None:
        """Refuse a subset that Stage 2 is given and that breaks these limits.

        Raises:
            InputError: a source is missing, excluded or unknown, or there are too many of them.
        """
        require_known("frozen_blocks", self.frozen_blocks, blocks, "block")
        require_known("include", self.include, subset, "source")
        for name in subset:
            if name in self.exclude:
                raise InputError(
                    f"sources: found {name!r}, which exclude forbids: leave it out of the subset"
                )
        if self.largest is not None and len(subset) > self.largest:
            raise InputError(f"sources: found {len(subset)}, expected at most {self.largest} (largest)")


def subset_of(subset: Recipe | Iterable[str]) -> tuple[str, ...]:
    """The names that take part: a recipe's sources with a weight above 0 in some block, or names as given.

    Raises:
        InputError: the names are one string, or one comes twice.
    """
    if not isinstance(subset, Recipe):
        return distinct_names("subset", subset)
    # A source that weighs nothing in every block takes no part, though the recipe lists it.
    rows = subset.weights
    return tuple(name for e, name in enumerate(subset.sources) if any(row[e] > 0 for row in rows))


def transfer(subset: Recipe | Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """A subset found on one pool, for another pool whose sources have the same names.

    Args:
        subset: a recipe, or the names of a subset.
        names: the other pool's sources.

    Returns:
        The subset's names in the other pool's order.

    Raises:
        InputError: the other pool has no source of that name; the nearest name is suggested.
    """
    wanted, known = subset_of(subset), distinct_names("names", names)
    require_known("subset", wanted, known, "source")
    return tuple(name for name in known if name in wanted)
