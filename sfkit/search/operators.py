"""Genetic operators over subsets (StereoFactory, Sec. 4.3, "Genetic Operators", eqs. 5 and 7).

Every function is pure: chromosomes go in, new ones come out, and the generator is an argument.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np

Chromosome = tuple[int, ...]
"""Distinct indices of sources (eq. 5); their order matters to crossover alone."""

SMALLEST = 2
"""The smallest subset there is (eq. 3)."""

Option = TypeVar("Option")


class Mutation(StrEnum):
    """The three mutation operators."""

    REPLACE = "replace"
    INSERT = "insert"
    DELETE = "delete"


@dataclass(frozen=True)
class SubsetSpace:
    """The chromosomes a search may hold.

    Attributes:
        allowed: indices of sources that may take part, ascending.
        required: those among them that must take part.
        largest: the most genes a chromosome may have.
    """

    allowed: tuple[int, ...]
    required: frozenset[int]
    largest: int

    @classmethod
    def free(cls, count: int) -> SubsetSpace:
        """Every subset of two or more out of ``count`` sources (eq. 3)."""
        return cls(tuple(range(count)), frozenset(), count)

    @property
    def smallest(self) -> int:
        """The fewest genes a chromosome may have."""
        return max(SMALLEST, len(self.required))

    @property
    def optional(self) -> tuple[int, ...]:
        """Sources that may be in or out, ascending."""
        return tuple(source for source in self.allowed if source not in self.required)

    @property
    def subsets(self) -> int:
        """How many different subsets there are: 2036 for 11 sources without constraints (Sec. 4.1)."""
        sizes = range(self.smallest, self.largest + 1)
        return sum(math.comb(len(self.optional), size - len(self.required)) for size in sizes)

    def absent(self, chromosome: Sequence[int]) -> tuple[int, ...]:
        """Allowed sources that the chromosome lacks, ascending."""
        return tuple(source for source in self.allowed if source not in chromosome)

    def removable(self, chromosome: Sequence[int]) -> tuple[int, ...]:
        """Positions whose source is not required."""
        return tuple(i for i, source in enumerate(chromosome) if source not in self.required)

    def holds(self, chromosome: Sequence[int]) -> bool:
        """True for a valid chromosome: distinct, allowed, nothing required missing, of a legal size."""
        genes = set(chromosome)
        return (
            len(genes) == len(chromosome)
            and self.required <= genes <= set(self.allowed)
            and self.smallest <= len(genes) <= self.largest
        )


def random_chromosome(space: SubsetSpace, rng: np.random.Generator) -> Chromosome:
    """Draw a size k ~ Uniform(smallest, largest), then k distinct sources, in random order."""
    size = int(rng.integers(space.smallest, space.largest, endpoint=True))
    drawn = rng.choice(space.optional, size - len(space.required), replace=False)
    # Sorted, since the order of a set is no part of the seed.
    genes = rng.permutation([*sorted(space.required), *drawn])
    return tuple(int(gene) for gene in genes)


def exchange_tails(
    first: Chromosome, second: Chromosome, cut_first: int, cut_second: int
) -> tuple[Chromosome, Chromosome]:
    """One-point crossover at given cuts, each the number of genes before it (eq. 7); may leave duplicates."""
    return first[:cut_first] + second[cut_second:], second[:cut_second] + first[cut_first:]


def repair(chromosome: Sequence[int], space: SubsetSpace, rng: np.random.Generator) -> Chromosome:
    """Make a chromosome valid that holds allowed sources, possibly twice.

    Later duplicates go, and a chromosome that is too short is filled up with random sources, as Sec. 4.3
    has it. Where constraints ask for it, missing required sources are appended and random others go
    until the largest size is met. A valid chromosome comes back as it is, without a draw.
    """
    # Of equals the first stays, and so does the order, which crossover goes by.
    genes = list(dict.fromkeys(chromosome))
    genes += sorted(space.required - set(genes))
    while len(genes) > space.largest:
        del genes[_pick(space.removable(genes), rng)]
    while len(genes) < space.smallest:
        genes.append(_pick(space.absent(genes), rng))
    return tuple(genes)


def crossover(
    first: Chromosome, second: Chromosome, space: SubsetSpace, rng: np.random.Generator
) -> tuple[Chromosome, Chromosome]:
    """Exchange the tails of two parents at cuts in [1, k - 1] (eq. 7), then repair both offspring."""
    # At least one gene of either parent goes into each offspring.
    cut_first = int(rng.integers(1, len(first)))
    cut_second = int(rng.integers(1, len(second)))
    one, other = exchange_tails(first, second, cut_first, cut_second)
    return repair(one, space, rng), repair(other, space, rng)


def possible_mutations(chromosome: Chromosome, space: SubsetSpace) -> tuple[Mutation, ...]:
    """The operators that can act: insert needs room, delete needs more than the smallest size."""
    absent, removable = space.absent(chromosome), space.removable(chromosome)
    # An operator that cannot act would make a copy, which costs a place in the population.
    able = {
        Mutation.REPLACE: bool(absent and removable),
        Mutation.INSERT: bool(absent) and len(chromosome) < space.largest,
        Mutation.DELETE: bool(removable) and len(chromosome) > space.smallest,
    }
    return tuple(mutation for mutation in Mutation if able[mutation])


def replace(chromosome: Chromosome, space: SubsetSpace, rng: np.random.Generator) -> Chromosome:
    """Put a source that is absent in the place of a random one."""
    position = _pick(space.removable(chromosome), rng)
    return (*chromosome[:position], _pick(space.absent(chromosome), rng), *chromosome[position + 1 :])


def insert(chromosome: Chromosome, space: SubsetSpace, rng: np.random.Generator) -> Chromosome:
    """Put a source that is absent at a random position, the end included."""
    position = int(rng.integers(len(chromosome) + 1))
    return (*chromosome[:position], _pick(space.absent(chromosome), rng), *chromosome[position:])


def delete(chromosome: Chromosome, space: SubsetSpace, rng: np.random.Generator) -> Chromosome:
    """Remove the source at a random position."""
    position = _pick(space.removable(chromosome), rng)
    return (*chromosome[:position], *chromosome[position + 1 :])


_ACTIONS = {Mutation.REPLACE: replace, Mutation.INSERT: insert, Mutation.DELETE: delete}


def mutate(
    chromosome: Chromosome, space: SubsetSpace, rng: np.random.Generator, *, redraw: bool = True
) -> tuple[Chromosome, Mutation | None]:
    """Apply one of the three operators, drawn uniformly.

    Args:
        chromosome: a valid chromosome; stays as it is.
        space: what chromosomes may hold.
        rng: where every draw comes from.
        redraw: what happens where the operator drawn cannot act (insert into a full chromosome, delete
            from one of the smallest size, replace where no source is absent): True draws again among
            those that can, False leaves the chromosome unmutated.

    Returns:
        The new chromosome, and the operator that acted (None where none did).
    """
    possible = possible_mutations(chromosome, space)
    options = possible if redraw and possible else tuple(Mutation)
    mutation = _pick(options, rng)
    if mutation not in possible:
        return chromosome, None
    return _ACTIONS[mutation](chromosome, space, rng), mutation


def tournament(ranks: Sequence[tuple[float, int]], rng: np.random.Generator) -> int:
    """Binary tournament: draw two positions, with replacement, and return the one of the smaller rank."""
    first, second = (int(i) for i in rng.integers(len(ranks), size=2))
    return first if ranks[first] <= ranks[second] else second


def _pick(options: Sequence[Option], rng: np.random.Generator) -> Option:
    # Not rng.choice, which would make an array of them.
    return options[int(rng.integers(len(options)))]
