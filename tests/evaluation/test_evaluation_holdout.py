"""Splits of validation pairs: who is held out, and both scores by hand from one evaluation."""

from __future__ import annotations

import math

import pytest
from flat_world import benchmark, calls, flat_pool
from hypothesis import given
from hypothesis import strategies as st

from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation import CombinedScorer, Evaluator
from sfkit.evaluation.holdout import check_holdout, deal, held_out, splits_of
from sfkit.evaluation.outcome import Part
from sfkit.merging import Pool

sizes = st.lists(st.integers(1, 9), min_size=1, max_size=4).filter(lambda found: sum(found) >= 2)


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"))


@given(sizes, st.floats(0.01, 0.99), st.integers(0, 50))
def test_a_share_holds_out_its_part_of_the_whole_and_of_each(
    sizes: list[int], share: float, seed: int
) -> None:
    dealt = deal(sizes, share, seed)
    counts = [len(held) for (held,) in dealt]
    wanted = min(max(round(sum(sizes) * share), 1), sum(sizes) - 1)
    assert sum(counts) == wanted
    for count, size, (held,) in zip(counts, sizes, dealt, strict=True):
        assert abs(count - size * wanted / sum(sizes)) < 1, "its share, within a pair"
        assert held <= set(range(size))


@given(sizes, st.integers(2, 6), st.integers(0, 50))
def test_folds_hold_out_every_pair_once(sizes: list[int], folds: int, seed: int) -> None:
    dealt = deal(sizes, folds, seed)
    for size, held in zip(sizes, dealt, strict=True):
        assert sorted(image for fold in held for image in fold) == list(range(size))
    together = [sum(len(held[n]) for held in dealt) for n in range(len(dealt[0]))]
    assert len(together) == min(folds, sum(sizes))
    assert max(together) - min(together) <= 1


def test_the_seed_alone_says_who() -> None:
    assert deal([20], 0.5, 3) == deal([20], 0.5, 3)
    assert len({deal([20], 0.5, seed) for seed in range(8)}) > 1


def test_single_pairs_as_folds_leave_one_benchmark_out() -> None:
    assert deal([1, 1, 1, 1], 4, 0) == tuple(
        tuple(frozenset({0}) if n == b else frozenset() for n in range(4)) for b in range(4)
    )


def test_both_scores_by_hand_from_the_same_passes_under_the_same_key(pool: Pool) -> None:
    """Level 4 against truths of 5, 8, 6 and 1 px: errors of 1, 4, 2 and 3."""
    whole = Evaluator(pool, benchmark(truths=(5.0, 8.0, 6.0, 1.0), metric="epe"))
    (plain,) = whole([pool.equal("low")])
    passes = len(calls)
    split = whole.with_splits([{1, 3}, {0}])
    (found,) = split([pool.equal("low")])
    assert len(calls) == passes, "no forward pass of its own"
    assert (found.score, found.key, found.cached) == (plain.score, plain.key, True)
    assert found.score == (1 + 4 + 2 + 3) / 4
    assert found.parts == (Part((1 + 2) / 2, (4 + 3) / 2), Part((4 + 2 + 3) / 3, 1.0))
    assert plain.parts == ()
    assert split.engine is whole.engine
    assert splits_of(split) == 2
    assert splits_of(whole) == 0


def test_a_failed_candidate_has_no_parts(pool: Pool) -> None:
    split = Evaluator(pool, benchmark(truths=(5.0, 8.0, 6.0, 1.0))).with_splits([{0}])
    (failed,) = split([pool.equal("wild")])
    assert failed.failed
    assert failed.parts == ()


@pytest.mark.parametrize(("how", "guiding", "held"), [("mean", 2.0, 3.5), ("worst", 3.0, 4.0)])
def test_combined_parts_by_hand(pool: Pool, how: str, guiding: float, held: float) -> None:
    """Level 4: errors 1 and 4 px on the one benchmark, 3 and 3 on the other; second pairs are held."""
    one = Evaluator(pool, benchmark("one", (5.0, 8.0), metric="epe")).with_splits([{1}])
    other = Evaluator(pool, benchmark("other", (7.0, 1.0), metric="epe")).with_splits([{1}])
    (found,) = CombinedScorer([one, other], how)([pool.equal("low")])
    assert found.parts == (Part(guiding, held),)


def test_a_benchmark_without_an_image_in_a_part_does_not_count_there(pool: Pool) -> None:
    one = Evaluator(pool, benchmark("one", (5.0,), metric="epe")).with_splits([{0}])
    other = Evaluator(pool, benchmark("other", (7.0,), metric="epe")).with_splits([()])
    assert math.isnan(one([pool.equal("low")])[0].parts[0].guiding)
    (found,) = CombinedScorer([one, other])([pool.equal("low")])
    assert found.parts == (Part(guiding=3.0, held=1.0),)


def test_fewer_than_four_pairs_are_not_split_and_a_sentence_says_so(pool: Pool) -> None:
    few = Evaluator(pool, benchmark(truths=(5.0, 8.0, 6.0)))
    with pytest.warns(SfkitWarning, match="found 3 validation pairs, expected at least 4 to hold some out"):
        assert held_out(few, 0.5) is few
    single = CombinedScorer([Evaluator(pool, benchmark("one", (5.0,)))])
    with pytest.warns(SfkitWarning, match="found 1 validation pair, expected"):
        assert held_out(single, 3) is single
    four = Evaluator(pool, benchmark(truths=(5.0, 8.0, 6.0, 1.0)))
    assert splits_of(held_out(four, 0.5)) == 1
    assert splits_of(held_out(four, 9)) == 4, "no more folds than pairs"
    assert held_out(four, 0) is four
    both = CombinedScorer([Evaluator(pool, benchmark(name, (5.0, 8.0))) for name in ("one", "other")])
    assert splits_of(held_out(both, 0.25)) == 1, "pairs of all benchmarks count together"


def test_a_scorer_that_knows_no_images_is_refused() -> None:
    with pytest.raises(InputError, match="holdout: found a scorer of the kind function, expected"):
        held_out(lambda recipes: [], 0.5)


@pytest.mark.parametrize("value", [-0.1, 1, 1.0, 1.5, 2.5, True, "half", math.nan, math.inf])
def test_what_is_neither_share_nor_folds_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"holdout: found .*, expected 0 for none, a share"):
        check_holdout("holdout", value)


@pytest.mark.parametrize("value", [0, 0.0, 0.5, 0.999, 2, 5, 5.0])
def test_shares_and_folds_are_taken(value: float) -> None:
    check_holdout("holdout", value)
