"""One generation of Stage 1 (StereoFactory, Algorithm 1): pure functions, the generator an argument."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sfkit.search.checks import LARGEST_POPULATION
from sfkit.search.operators import Chromosome, SubsetSpace, crossover, mutate, random_chromosome, tournament
from sfkit.settings import between, one_of, setting, settle, whole

if TYPE_CHECKING:
    import numpy as np

SURVIVAL = ("tournament", "truncation")
"""Ways to choose the next population out of parents and offspring."""

Rank = tuple[float, int]
"""(fitness, number) of a candidate: smaller is better, so that ties go to the earlier one."""


@dataclass(frozen=True)
class SubsetSettings:
    """Settings of Stage 1; the defaults are the paper's.

    Settled where the paper is silent: offspring that do not cross over copy their parents, and may still
    mutate; tournaments draw with replacement, so that one candidate can survive more than once; ties go
    to the earlier candidate; an odd ``population`` breeds one offspring more than its size, since
    offspring come in pairs (Algorithm 1, lines 6 to 10).

    Attributes:
        population: M, chromosomes in a population, at least 2.
        generations: T_1, generations after the initial population; 0 scores the initial one alone.
        crossover: p_c, the probability that a pair of parents crosses over, in [0, 1].
        mutation: p_m, the probability that an offspring mutates, in [0, 1].
        redraw: what a mutation does that cannot act, such as replace or insert in a full chromosome and
            delete from one of two: True (our choice) draws again among those that can, so that p_m is
            the rate of mutations; False leaves the offspring as it is.
        survival: ``"tournament"`` is the paper's; ``"truncation"`` keeps the M best different subsets
            of parents and offspring (fewer where there are fewer), as (mu + lambda) selection without
            duplicates does. With M = 20 and T_1 = 39, as many candidates as the paper's, the latter came
            nearer the optimum at every number of evaluations (``benchmarks/search.py``).
        seed: at least 0; the same seed and the same scores give the same search.

    Raises:
        InputError: a value out of its range.
    """

    population: int = setting(50, help="Subsets in a population (M).", check=whole(2, LARGEST_POPULATION))
    generations: int = setting(15, help="Generations after the first population (T_1).", check=whole(0))
    crossover: float = setting(
        0.8, help="Probability that two parents cross over (p_c).", check=between(0.0, 1.0)
    )
    mutation: float = setting(
        0.3, help="Probability that an offspring mutates (p_m).", check=between(0.0, 1.0)
    )
    redraw: bool = setting(
        default=True, help="Whether another mutation is drawn where the one drawn cannot act."
    )
    survival: str = setting(
        "tournament",
        help="tournament, as the paper, or truncation (best with population 20).",
        check=one_of(SURVIVAL),
    )
    seed: int = setting(0, help="Governs every draw.", check=whole(0))

    @property
    def offspring(self) -> int:
        """Candidates that a generation creates; they come in pairs."""
        return self.population + self.population % 2

    def proposals(self, space: SubsetSpace) -> int:
        """The most candidates of a search without starts, those met again included."""
        return self.population + self.generations * self.offspring

    def alone(self, space: SubsetSpace) -> int:
        """How many of them are one source each, and so no subset that may be chosen."""
        return 0

    def __post_init__(self) -> None:
        settle(self)


@dataclass(frozen=True)
class Draft:
    """A chromosome that waits for its score; parents and operators as in ``SubsetCandidate``."""

    chromosome: Chromosome
    parents: tuple[int, ...]
    operators: tuple[str, ...]


def initial(
    settings: SubsetSettings, space: SubsetSpace, starts: Sequence[Chromosome], rng: np.random.Generator
) -> tuple[Draft, ...]:
    """The initial population: the starts, then random chromosomes up to M (Algorithm 1, line 1)."""
    given = [Draft(chromosome, (), ("start",)) for chromosome in starts]
    missing = settings.population - len(given)
    return (*given, *(Draft(random_chromosome(space, rng), (), ("random",)) for _ in range(missing)))


def bred(
    parents: Sequence[tuple[Chromosome, Rank]],
    settings: SubsetSettings,
    space: SubsetSpace,
    rng: np.random.Generator,
) -> tuple[Draft, ...]:
    """The offspring Q_t of a population (Algorithm 1, lines 5 to 11).

    Args:
        parents: chromosome and rank of each member of P_{t-1}.
        settings: M, p_c, p_m and ``redraw``.
        space: what chromosomes may hold.
        rng: where every draw comes from.
    """
    ranks = [rank for _, rank in parents]
    offspring: list[Draft] = []
    # In pairs: of an odd population there is one offspring more.
    while len(offspring) < settings.population:
        first = parents[tournament(ranks, rng)]
        second = parents[tournament(ranks, rng)]
        for draft in _pair(first, second, settings, space, rng):
            offspring.append(_mutated(draft, settings, space, rng))
    return tuple(offspring)


def survivors(
    pool: Sequence[tuple[Chromosome, Rank]], settings: SubsetSettings, rng: np.random.Generator
) -> tuple[Rank, ...]:
    """The next population out of P_{t-1} and Q_t (Algorithm 1, line 14).

    Args:
        pool: chromosome and rank of each member of both.
        settings: M and ``survival``.
        rng: where every draw comes from; truncation draws nothing.

    Returns:
        M ranks: the winners of M - 1 tournaments, then the best of the pool. By truncation the best of
        the pool, best first, each subset once.
    """
    if settings.survival == "truncation":
        # By set: the same subset in another order would fill the population with copies.
        best: dict[frozenset[int], Rank] = {}
        for chromosome, rank in sorted(pool, key=lambda member: member[1]):
            best.setdefault(frozenset(chromosome), rank)
        return tuple(best.values())[: settings.population]
    ranks = [rank for _, rank in pool]
    winners = [ranks[tournament(ranks, rng)] for _ in range(settings.population - 1)]
    # The best of all always survives, so that a population's best is the best so far.
    return (*winners, min(ranks))


def _pair(
    first: tuple[Chromosome, Rank],
    second: tuple[Chromosome, Rank],
    settings: SubsetSettings,
    space: SubsetSpace,
    rng: np.random.Generator,
) -> tuple[Draft, Draft]:
    (one, (_, mother)), (other, (_, father)) = first, second
    if rng.random() >= settings.crossover:
        # Where the paper is silent: with probability 1 - p_c offspring copy their parents.
        return Draft(one, (mother,), ("copy",)), Draft(other, (father,), ("copy",))
    one, other = crossover(one, other, space, rng)
    return Draft(one, (mother, father), ("crossover",)), Draft(other, (father, mother), ("crossover",))


def _mutated(draft: Draft, settings: SubsetSettings, space: SubsetSpace, rng: np.random.Generator) -> Draft:
    if rng.random() >= settings.mutation:
        return draft
    chromosome, mutation = mutate(draft.chromosome, space, rng, redraw=settings.redraw)
    if mutation is None:
        return draft
    return Draft(chromosome, draft.parents, (*draft.operators, str(mutation)))
