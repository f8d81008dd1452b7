"""Genetic operators against hand-made cases, set algebra and their frequencies."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.search.operators import (
    Mutation,
    SubsetSpace,
    crossover,
    delete,
    exchange_tails,
    insert,
    mutate,
    possible_mutations,
    random_chromosome,
    repair,
    replace,
    tournament,
)

DRAWS = 4000


def within(count: int, probability: float, draws: int = DRAWS) -> bool:
    """Five standard deviations of a binomial count around its mean."""
    spread = (draws * probability * (1 - probability)) ** 0.5
    return abs(count - draws * probability) <= 5 * spread


@st.composite
def spaces(draw: st.DrawFn) -> SubsetSpace:
    count = draw(st.integers(2, 9))
    allowed = draw(st.sets(st.integers(0, count - 1), min_size=2))
    required = draw(st.sets(st.sampled_from(sorted(allowed))))
    largest = draw(st.integers(max(2, len(required)), len(allowed)))
    return SubsetSpace(tuple(sorted(allowed)), frozenset(required), largest)


generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def test_exchange_tails_is_equation_7_by_hand() -> None:
    first, second = (1, 2, 3, 4, 5), (6, 7, 8)
    assert exchange_tails(first, second, 2, 1) == ((1, 2, 7, 8), (6, 3, 4, 5))
    assert exchange_tails(first, second, 4, 2) == ((1, 2, 3, 4, 8), (6, 7, 5))


def test_repair_drops_later_duplicates_and_keeps_the_order() -> None:
    rng = np.random.default_rng(0)
    assert repair((3, 1, 3, 2, 1), SubsetSpace.free(5), rng) == (3, 1, 2)


def test_repair_fills_up_one_gene_with_any_other_source() -> None:
    seen = {repair((2, 2), SubsetSpace.free(4), np.random.default_rng(seed)) for seed in range(60)}
    assert seen == {(2, 0), (2, 1), (2, 3)}


def test_repair_of_a_valid_chromosome_draws_nothing() -> None:
    rng = np.random.default_rng(1)
    before = rng.bit_generator.state
    assert repair((4, 0, 2), SubsetSpace.free(5), rng) == (4, 0, 2)
    assert rng.bit_generator.state == before


def test_repair_appends_required_sources_and_trims_others() -> None:
    space = SubsetSpace((0, 1, 2, 3), frozenset({3}), 2)
    seen = {repair((0, 1, 2), space, np.random.default_rng(seed)) for seed in range(60)}
    assert seen == {(0, 3), (1, 3), (2, 3)}


def test_crossover_reaches_exactly_the_offspring_of_all_cuts() -> None:
    first, second = (0, 1, 2), (3, 4, 5, 6)
    expected = {exchange_tails(first, second, a, b) for a in (1, 2) for b in (1, 2, 3)}
    space = SubsetSpace.free(7)
    drawn = Counter(crossover(first, second, space, np.random.default_rng(seed)) for seed in range(1200))
    assert set(drawn) == expected
    assert all(within(n, 1 / 6, 1200) for n in drawn.values())


def test_crossover_of_pairs_that_collapse_is_augmented() -> None:
    # Cuts are forced (k = 2): (0, 1) x (2, 0) gives (0, 0) and (2, 1).
    seen = {crossover((0, 1), (2, 0), SubsetSpace.free(3), np.random.default_rng(s)) for s in range(40)}
    assert seen == {((0, 1), (2, 1)), ((0, 2), (2, 1))}


@pytest.mark.parametrize(
    ("operator", "expected"),
    [
        (replace, {(2, 1), (3, 1), (0, 2), (0, 3)}),
        (insert, {(n, 0, 1) for n in (2, 3)} | {(0, n, 1) for n in (2, 3)} | {(0, 1, n) for n in (2, 3)}),
    ],
)
def test_mutation_reaches_exactly_its_neighbours_uniformly(operator, expected) -> None:
    drawn = Counter(operator((0, 1), SubsetSpace.free(4), np.random.default_rng(s)) for s in range(DRAWS))
    assert set(drawn) == expected
    assert all(within(n, 1 / len(expected)) for n in drawn.values())


def test_delete_reaches_every_position_but_the_required() -> None:
    space = SubsetSpace((0, 1, 2, 3), frozenset({1}), 4)
    seen = {delete((0, 1, 2, 3), space, np.random.default_rng(seed)) for seed in range(60)}
    assert seen == {(1, 2, 3), (0, 1, 3), (0, 1, 2)}


@pytest.mark.parametrize(
    ("chromosome", "count", "expected"),
    [
        ((0, 1), 2, ()),
        ((0, 1), 4, (Mutation.REPLACE, Mutation.INSERT)),
        ((0, 1, 2), 3, (Mutation.DELETE,)),
        ((0, 1, 2), 4, (Mutation.REPLACE, Mutation.INSERT, Mutation.DELETE)),
    ],
)
def test_possible_mutations_by_size(chromosome, count, expected) -> None:
    assert possible_mutations(chromosome, SubsetSpace.free(count)) == expected


def test_mutations_are_drawn_uniformly_among_all_three() -> None:
    rng = np.random.default_rng(3)
    drawn = Counter(mutate((0, 1, 2), SubsetSpace.free(5), rng)[1] for _ in range(DRAWS))
    assert set(drawn) == set(Mutation)
    assert all(within(n, 1 / 3) for n in drawn.values())


def test_redraw_turns_what_cannot_act_into_what_can() -> None:
    rng = np.random.default_rng(4)
    full = Counter(mutate((0, 1, 2), SubsetSpace.free(3), rng)[1] for _ in range(200))
    assert full == {Mutation.DELETE: 200}
    pair = Counter(mutate((0, 1), SubsetSpace.free(5), rng)[1] for _ in range(DRAWS))
    assert set(pair) == {Mutation.REPLACE, Mutation.INSERT}
    assert within(pair[Mutation.INSERT], 1 / 2)


def test_without_redraw_two_of_three_draws_leave_a_full_chromosome() -> None:
    rng = np.random.default_rng(5)
    drawn = [mutate((0, 1, 2), SubsetSpace.free(3), rng, redraw=False) for _ in range(DRAWS)]
    assert within(sum(mutation is None for _, mutation in drawn), 2 / 3)
    assert all(new == (0, 1, 2) for new, mutation in drawn if mutation is None)
    assert all(len(new) == 2 for new, mutation in drawn if mutation is Mutation.DELETE)


def test_the_only_subset_there_is_never_mutates() -> None:
    space = SubsetSpace.free(2)
    for redraw in (True, False):
        assert mutate((1, 0), space, np.random.default_rng(0), redraw=redraw) == ((1, 0), None)


def test_sizes_of_random_chromosomes_are_uniform() -> None:
    rng = np.random.default_rng(6)
    sizes = Counter(len(random_chromosome(SubsetSpace.free(6), rng)) for _ in range(DRAWS))
    assert set(sizes) == {2, 3, 4, 5, 6}
    assert all(within(n, 1 / 5) for n in sizes.values())


def test_members_and_order_of_random_chromosomes_are_uniform() -> None:
    rng = np.random.default_rng(7)
    space = SubsetSpace((0, 1, 2, 3), frozenset(), 2)
    drawn = Counter(random_chromosome(space, rng) for _ in range(DRAWS))
    assert set(drawn) == set(itertools.permutations(range(4), 2))
    assert all(within(n, 1 / 12) for n in drawn.values())


def test_tournament_wins_follow_the_binary_formula() -> None:
    rng = np.random.default_rng(8)
    ranks = [(3.0, 0), (1.0, 1), (1.0, 2), (np.inf, 3)]
    wins = Counter(tournament(ranks, rng) for _ in range(DRAWS))
    # The i-th best of n wins (2 (n - i) + 1) / n^2 of the draws; of the two 1.0 the earlier is better.
    for place, i in enumerate((1, 2, 0, 3), start=1):
        assert within(wins[i], (2 * (4 - place) + 1) / 16)


def test_eleven_sources_have_the_papers_2036_subsets() -> None:
    assert SubsetSpace.free(11).subsets == 2036


@given(spaces())
def test_subsets_are_counted_as_by_enumeration(space: SubsetSpace) -> None:
    sizes = range(space.smallest, space.largest + 1)
    chosen = [c for size in sizes for c in itertools.combinations(space.allowed, size)]
    assert space.subsets == sum(space.required <= set(c) for c in chosen)
    assert all(space.holds(c) == (space.required <= set(c)) for c in chosen)


@given(spaces(), generators)
def test_every_operator_returns_valid_chromosomes(space: SubsetSpace, rng: np.random.Generator) -> None:
    first, second = random_chromosome(space, rng), random_chromosome(space, rng)
    children = crossover(first, second, space, rng)
    mutants = [mutate(c, space, rng, redraw=redraw)[0] for c in children for redraw in (True, False)]
    for chromosome in (first, second, *children, *mutants):
        assert len(set(chromosome)) == len(chromosome)
        assert space.required <= set(chromosome) <= set(space.allowed)
        assert max(2, len(space.required)) <= len(chromosome) <= space.largest
        assert all(type(gene) is int for gene in chromosome)


@given(spaces(), generators)
def test_a_mutation_changes_what_its_name_says(space: SubsetSpace, rng: np.random.Generator) -> None:
    before = random_chromosome(space, rng)
    after, mutation = mutate(before, space, rng)
    lost, won = set(before) - set(after), set(after) - set(before)
    changes = {
        None: (0, 0),
        Mutation.REPLACE: (1, 1),
        Mutation.INSERT: (0, 1),
        Mutation.DELETE: (1, 0),
    }
    assert (len(lost), len(won)) == changes[mutation]
    assert (mutation is None) == (space.subsets == 1)


@given(spaces(), generators)
def test_offspring_hold_only_genes_of_their_parents_or_fillers(
    space: SubsetSpace, rng: np.random.Generator
) -> None:
    first, second = random_chromosome(space, rng), random_chromosome(space, rng)
    copies = tuple(first), tuple(second)
    for child in crossover(first, second, space, rng):
        strangers = set(child) - set(first) - set(second)
        assert not strangers or len(child) == space.smallest
    assert (first, second) == copies


@given(spaces(), st.integers(0, 2**32 - 1))
def test_the_same_generator_gives_the_same_offspring(space: SubsetSpace, seed: int) -> None:
    def bred() -> object:
        rng = np.random.default_rng(seed)
        parents = random_chromosome(space, rng), random_chromosome(space, rng)
        return [mutate(child, space, rng) for child in crossover(*parents, space, rng)]

    assert bred() == bred()
