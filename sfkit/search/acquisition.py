"""Where a bound over subsets is smallest: all of them looked through, or the operators of Stage 1 at work.

A batch takes smallest bounds one after the other, each by a model that believes in those before it; draws of
the posterior in their place (Thompson sampling) needed more (``benchmarks/sections/thompson.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import lru_cache
from itertools import combinations, islice

import numpy as np

from sfkit.search.breeding import Rank, SubsetSettings, bred, initial, survivors
from sfkit.search.gaussian_process import Array
from sfkit.search.operators import Chromosome, SubsetSpace

LISTED = 4096
"""Spaces of up to so many subsets are looked through as a whole."""
BREEDING = SubsetSettings(population=40, generations=10, mutation=0.6, survival="truncation")
"""Of the genetic algorithm that looks through larger ones; no network runs for it."""

Bound = Callable[[Array], Array]
"""Weights of equal merges, (m, N), -> what is minimised, (m,)."""


def smallest_bound(
    bound: Bound,
    space: SubsetSpace,
    count: int,
    met: Collection[Chromosome],
    best: Sequence[Chromosome],
    rng: np.random.Generator,
) -> Chromosome:
    """The subset of the smallest bound among those not met; the earlier one of a tie.

    Where the genetic algorithm meets nothing new, as it may when nearly all is met, the first ``LISTED`` of
    what is left are looked through.

    Args:
        bound: what is minimised.
        space: what may be proposed; at least one subset of it is not met.
        count: N, sources in the pool.
        met: ascending chromosomes that are left out.
        best: where the genetic algorithm begins, in large spaces.
        rng: its draws; none in small spaces.
    """
    if space.subsets <= LISTED:
        options, weights = listed(space), _listed_weights(space, count)
    else:
        options = _bred(bound, space, count, best, rng)
        weights = equal_weights(options, count)
    # Left out here: the listing is the same for every proposal, what is met is not.
    fresh = [n for n, chromosome in enumerate(options) if chromosome not in met]
    if not fresh:
        # Reads past what is met and no further: a space of 2^30 is never listed.
        options = tuple(islice(unmet(space, met), LISTED))
        weights = equal_weights(options, count)
        fresh = list(range(len(options)))
    return options[fresh[int(np.argmin(bound(weights[fresh])))]]


def equal_weights(chromosomes: Sequence[Chromosome], count: int) -> Array:
    """Weights of the equal merges, (m, count)."""
    weights = np.zeros((len(chromosomes), count))
    for row, chromosome in zip(weights, chromosomes, strict=True):
        row[list(chromosome)] = 1.0 / len(chromosome)
    return weights


def unmet(space: SubsetSpace, met: Collection[Chromosome]) -> Iterator[Chromosome]:
    """Every subset of a space that is not among these, genes ascending, small ones first."""
    required = tuple(sorted(space.required))
    for size in range(space.smallest, space.largest + 1):
        for chosen in combinations(space.optional, size - len(required)):
            chromosome = tuple(sorted((*required, *chosen)))
            if chromosome not in met:
                yield chromosome


# Every proposal asks for the same listing.
@lru_cache(maxsize=8)
def listed(space: SubsetSpace) -> tuple[Chromosome, ...]:
    """Every subset of a space, genes ascending, small ones first."""
    return tuple(unmet(space, ()))


@lru_cache(maxsize=8)
def _listed_weights(space: SubsetSpace, count: int) -> Array:
    """Weights of all of them, not to be written to."""
    weights = equal_weights(listed(space), count)
    weights.setflags(write=False)
    return weights


def _bred(
    bound: Bound, space: SubsetSpace, count: int, best: Sequence[Chromosome], rng: np.random.Generator
) -> tuple[Chromosome, ...]:
    """Every subset a genetic algorithm meets on its way down the bound, genes ascending."""
    met: dict[Chromosome, None] = {}
    numbered: list[tuple[Chromosome, Rank]] = []

    def ranked(chromosomes: Sequence[Chromosome]) -> list[tuple[Chromosome, Rank]]:
        # By sorted genes: the bound knows no order, and one subset must be met once.
        ordered = [tuple(sorted(chromosome)) for chromosome in chromosomes]
        met.update(dict.fromkeys(ordered))
        first = len(numbered)
        values = bound(equal_weights(ordered, count))
        numbered.extend(
            # The number breaks ties by age, as a search's does, and leads back to the chromosome.
            (c, (float(v), first + n))
            for n, (c, v) in enumerate(zip(ordered, values, strict=True))
        )
        return numbered[first:]

    # Half at the least are drawn: bred from the best known alone they would stay among these.
    starts = [*best][: BREEDING.population // 2]
    population = ranked([draft.chromosome for draft in initial(BREEDING, space, starts, rng)])
    for _ in range(BREEDING.generations):
        offspring = ranked([draft.chromosome for draft in bred(population, BREEDING, space, rng)])
        chosen = survivors([*population, *offspring], BREEDING, rng)
        population = [numbered[number] for _, number in chosen]
    return tuple(met)
