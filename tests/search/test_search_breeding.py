"""One generation of Algorithm 1: rates, pairs, survivors."""

from __future__ import annotations

import numpy as np
import pytest

from sfkit.errors import InputError
from sfkit.search.breeding import SubsetSettings, bred, initial, survivors
from sfkit.search.operators import SubsetSpace

SPACE = SubsetSpace.free(8)


def population(size: int, seed: int = 0):
    drafts = initial(SubsetSettings(population=size), SPACE, (), np.random.default_rng(seed))
    return [(draft.chromosome, (float(i), i)) for i, draft in enumerate(drafts)]


def test_the_defaults_are_the_papers() -> None:
    settings = SubsetSettings()
    assert (settings.population, settings.generations) == (50, 15)
    assert (settings.crossover, settings.mutation) == (0.8, 0.3)


def test_rates_of_crossover_and_mutation() -> None:
    settings = SubsetSettings(population=4000)
    drafts = bred(population(50), settings, SPACE, np.random.default_rng(1))
    crossed = sum(draft.operators[0] == "crossover" for draft in drafts) / 2
    mutated = sum(len(draft.operators) == 2 for draft in drafts)
    assert abs(crossed - 0.8 * 2000) < 5 * (2000 * 0.8 * 0.2) ** 0.5
    assert abs(mutated - 0.3 * 4000) < 5 * (4000 * 0.3 * 0.7) ** 0.5


def test_without_crossover_and_mutation_offspring_are_their_parents() -> None:
    parents = population(10)
    settings = SubsetSettings(population=10, crossover=0.0, mutation=0.0)
    by_number = {number: chromosome for chromosome, (_, number) in parents}
    for draft in bred(parents, settings, SPACE, np.random.default_rng(2)):
        (parent,) = draft.parents
        assert draft.operators == ("copy",)
        assert draft.chromosome == by_number[parent]


def test_the_first_parent_gave_the_head() -> None:
    parents = population(10)
    by_number = {number: chromosome for chromosome, (_, number) in parents}
    settings = SubsetSettings(population=40, crossover=1.0, mutation=0.0)
    for draft in bred(parents, settings, SPACE, np.random.default_rng(6)):
        assert draft.chromosome[0] == by_number[draft.parents[0]][0]


def test_certain_crossover_and_mutation_always_act() -> None:
    settings = SubsetSettings(population=40, crossover=1.0, mutation=1.0)
    for draft in bred(population(10), settings, SPACE, np.random.default_rng(3)):
        assert draft.operators[0] == "crossover"
        assert draft.operators[1] in {"replace", "insert", "delete"}
        assert len(draft.parents) == 2


@pytest.mark.parametrize(("size", "expected"), [(2, 2), (5, 6), (50, 50)])
def test_offspring_come_in_pairs(size: int, expected: int) -> None:
    settings = SubsetSettings(population=size)
    assert len(bred(population(size), settings, SPACE, np.random.default_rng(4))) == expected


def test_survivors_hold_the_best_whatever_the_draws() -> None:
    ranks = [(float(i % 7), i) for i in range(3, 24)]
    pool = [((0, 1), rank) for rank in ranks]
    for seed in range(30):
        chosen = survivors(pool, SubsetSettings(population=6), np.random.default_rng(seed))
        assert len(chosen) == 6
        assert chosen[-1] == (0.0, 7)
        assert set(chosen) <= set(ranks)


def test_one_candidate_can_survive_more_than_once() -> None:
    pool = [((0, 1), (0.0, 0)), ((0, 2), (1.0, 1))]
    settings = SubsetSettings(population=8)
    chosen = [survivors(pool, settings, np.random.default_rng(seed)) for seed in range(20)]
    assert all(entry.count((0.0, 0)) > 1 for entry in chosen)
    assert any((1.0, 1) in entry for entry in chosen)


def test_truncation_keeps_the_best_different_subsets_and_draws_nothing() -> None:
    pool = [
        ((0, 1), (2.0, 0)), ((1, 2), (1.0, 1)), ((2, 1), (1.0, 2)), ((0, 3), (3.0, 3)), ((3, 4), (1.0, 4)),
    ]  # fmt: skip
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    kept = survivors(pool, SubsetSettings(population=3, survival="truncation"), rng)
    assert kept == ((1.0, 1), (1.0, 4), (2.0, 0)), "best first, ties to the earlier, (2, 1) is (1, 2) again"
    assert len(survivors(pool, SubsetSettings(population=9, survival="truncation"), rng)) == 4
    assert rng.bit_generator.state == before


def test_starts_come_first_and_the_rest_is_random() -> None:
    drafts = initial(SubsetSettings(population=5), SPACE, ((4, 2), (0, 1, 7)), np.random.default_rng(5))
    assert [draft.chromosome for draft in drafts[:2]] == [(4, 2), (0, 1, 7)]
    assert [draft.operators for draft in drafts] == [("start",)] * 2 + [("random",)] * 3


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("population", 1, "population: found 1, expected a whole number of at least 2"),
        ("population", 10**9, "population: found 1000000000, expected a whole number of at most 100000"),
        ("population", 2.5, "population: found 2.5"),
        ("population", True, "population: found True"),
        ("generations", -1, "generations: found -1, expected a whole number of at least 0"),
        ("crossover", 1.1, "crossover: found 1.1, expected a finite number between 0 and 1"),
        ("mutation", float("nan"), "mutation: found nan, expected a finite number between 0 and 1"),
        ("mutation", "0.3", "mutation: found '0.3'"),
        ("survival", "elite", "unknown survival 'elite', expected one of: tournament, truncation"),
        ("seed", -1, "seed: found -1, expected a whole number of at least 0"),
    ],
)
def test_settings_out_of_range_are_refused(field: str, value: object, expected: str) -> None:
    with pytest.raises(InputError, match=expected.replace(".", r"\.")):
        SubsetSettings(**{field: value})


def test_numpy_numbers_are_numbers() -> None:
    settings = SubsetSettings(population=np.int64(4), mutation=np.float32(0.5))
    assert len(initial(settings, SPACE, (), np.random.default_rng(0))) == 4
