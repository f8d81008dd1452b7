"""Trimming, dropping, electing and weighted means: by hand, against plain formulas, and by their algebra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sfkit.checkpoints.checks import Kind, TensorSpec
from sfkit.errors import InputError
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.fusion import fuse
from sfkit.merging.magnitudes import kth_magnitude
from sfkit.merging.sparsity import PIECE, Row, Thresholds, pieces, thinned
from sfkit.merging.steps import Drop, Elect, FisherMean, Fused, Mean, Sparse, Trim, as_dicts, from_dicts

PARTITION = BlockPartition.of({"all": ["*"]})


def layout_of(*sizes: int, statistics: int = 0) -> FlatLayout:
    """Tensors t0, t1, ... of these sizes, and one of running statistics behind them."""
    specs = [TensorSpec(f"t{n}", (size,), Kind.WEIGHT) for n, size in enumerate(sizes)]
    if statistics:
        specs.append(TensorSpec("bn.running_var", (statistics,), Kind.STATISTIC))
    return FlatLayout.of(specs, PARTITION)


def row(values: torch.Tensor, name: str = "a") -> Row:
    return Row(name, lambda piece: values[piece.start : piece.stop])


def read(made: Row, layout: FlatLayout) -> torch.Tensor:
    return torch.cat([made.read(piece) for tensor in pieces(layout) for piece in tensor])


def through(
    values: Sequence[float] | torch.Tensor, step: Sparse, layout: FlatLayout | None = None
) -> torch.Tensor:
    """A task vector after one step; one tensor unless a layout says otherwise."""
    vector = torch.as_tensor(values, dtype=torch.float32)
    layout = layout or layout_of(vector.numel())
    return read(thinned(row(vector), step, layout, "b", Thresholds()), layout)


def fused(
    step: Fused, *vectors: Sequence[float] | torch.Tensor, statistics: int = 0, **more: object
) -> torch.Tensor:
    stack = [torch.as_tensor(vector, dtype=torch.float32) for vector in vectors]
    layout = layout_of(stack[0].numel() - statistics, statistics=statistics)
    out = torch.full((layout.size,), torch.nan)
    fuse(step, [row(vector, str(n)) for n, vector in enumerate(stack)], layout, out, **more)  # type: ignore[arg-type]
    return out


def close(found: torch.Tensor, expected: Sequence[float]) -> bool:
    return torch.allclose(found, torch.tensor(expected, dtype=torch.float32), atol=1e-6)


# Trim


def test_trimming_keeps_the_largest_and_every_tie_at_the_threshold() -> None:
    """int(0.4 * 5) = 2 entries; the second largest magnitude is 2, which three entries have."""
    assert close(through([3.0, -2.0, 0.5, 2.0, -2.0], Trim(0.4)), [3.0, -2.0, 0.0, 2.0, -2.0])
    assert close(through([3.0, -2.0, 0.5, 1.0, -1.5], Trim(0.4)), [3.0, -2.0, 0.0, 0.0, 0.0])


def test_trimming_keeps_at_least_one_entry_and_at_most_those_that_are_there() -> None:
    assert close(through([1.0, -4.0, 2.0], Trim(0.01)), [0.0, -4.0, 0.0])
    assert close(through([0.0, 0.0, 1.0, 0.0], Trim(0.75)), [0.0, 0.0, 1.0, 0.0])
    assert close(through([0.0, 0.0], Trim(0.5)), [0.0, 0.0])


def test_a_tensor_alone_chooses_among_its_own_entries() -> None:
    layout, values = layout_of(2, 2), [4.0, 3.0, 1.0, 0.5]
    assert close(through(values, Trim(0.5), layout), [4.0, 3.0, 0.0, 0.0])
    assert close(through(values, Trim(0.5, per="tensor"), layout), [4.0, 0.0, 1.0, 0.0])


def test_tensors_a_source_did_not_change_are_no_choice() -> None:
    """Half of the entries of the changed tensor, however much of the network is frozen."""
    assert close(through([2.0, 1.0, 0.0, 0.0, 0.0, 0.0], Trim(0.5), layout_of(2, 4)), [2.0, 0, 0, 0, 0, 0])


def test_running_statistics_are_neither_trimmed_nor_dropped() -> None:
    layout = layout_of(2, statistics=2)
    assert close(through([2.0, 1.0, 0.1, 0.2], Trim(0.5), layout), [2.0, 0.0, 0.1, 0.2])
    assert close(through([2.0, 1.0, 0.1, 0.2], Drop(0.999), layout)[2:], [0.1, 0.2])


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.0), st.sampled_from(["spread", "ties", "zeros"]))
def test_the_threshold_is_that_of_a_full_sort(seed: int, share: float, kind: str) -> None:
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(int(rng.integers(1, 5000))).astype(np.float32)
    if kind == "ties":
        values = np.round(values)
    elif kind == "zeros":
        values[rng.random(values.size) < 0.8] = 0.0
    k = max(1, int(share * values.size))
    chunks = [torch.from_numpy(part) for part in np.array_split(values, 7)]
    assert kth_magnitude(lambda: chunks, values.size, k) == np.sort(np.abs(values))[::-1][k - 1]


@pytest.mark.parametrize("order", [1, -1])
def test_a_sample_that_misleads_changes_nothing(order: int) -> None:
    """The sampled entries, every fourth of them, are all the smallest, or all the largest."""
    values = torch.arange(1 << 18, dtype=torch.float32)
    place = torch.arange(1 << 18).view(4, -1).T.reshape(-1)  # reads columns of the ramp: 0, n/4, n/2, ...
    mixed = values[place] if order == 1 else values.flip(0)[place]
    assert kth_magnitude(lambda: [mixed], mixed.numel(), 1000) == mixed.numel() - 1000


# Drop


def test_dropping_with_probability_0_is_no_step_and_density_1_none() -> None:
    assert Drop(0.0).idle
    assert Trim(1.0).idle
    assert close(through([1.0, -2.0], Drop(0.0)), [1.0, -2.0])


def test_what_is_not_dropped_is_enlarged_by_the_paper_and_its_mean_stays() -> None:
    values = torch.ones(200_000)
    left = through(values, Drop(0.75, seed=3))
    assert set(left.unique().tolist()) == {0.0, 4.0}
    assert float(left.mean()) == pytest.approx(1.0, abs=4 * np.sqrt(0.75 / 0.25 / 200_000))


def test_rescaling_by_norm_keeps_the_l1_norm_of_each_tensor() -> None:
    layout = layout_of(50_000, 300)
    values = torch.randn(layout.size, generator=torch.Generator().manual_seed(0))
    left = through(values, Drop(0.5, rescale="norm"), layout)
    for part in (slice(0, 50_000), slice(50_000, None)):
        assert float(left[part].abs().sum()) == pytest.approx(float(values[part].abs().sum()), rel=1e-5)
    bare = through(values, Drop(0.5, rescale="none"), layout)
    assert torch.equal(bare[bare != 0], values[bare != 0])


def test_draws_depend_on_seed_content_and_key_and_on_nothing_else() -> None:
    """A tensor's draws are the same wherever it lies: a pool that gains a source moves it."""
    values = torch.ones(3 * PIECE + 5)
    alone = through(values, Drop(0.5, seed=1))
    assert torch.equal(alone, through(values, Drop(0.5, seed=1)))
    assert not torch.equal(alone, through(values, Drop(0.5, seed=2)))
    shifted = FlatLayout.of(
        [TensorSpec("r", (7,), Kind.WEIGHT), TensorSpec("t0", (values.numel(),), Kind.WEIGHT)], PARTITION
    )
    moved = read(
        thinned(row(torch.ones(shifted.size)), Drop(0.5, seed=1), shifted, "b", Thresholds()), shifted
    )
    assert torch.equal(moved[7:], alone)
    assert not torch.equal(alone[:PIECE], alone[PIECE : 2 * PIECE])


# Elect, means


def test_the_paper_elects_plus_where_weights_before_the_election_would_elect_minus() -> None:
    """Tau = (1, -0.6), w = (0.3, 0.7): 1 - 0.6 > 0, and 0.3 - 0.42 < 0."""
    assert close(fused(Elect(), [1.0], [-0.6]), [1.0])
    weighted = Elect(sources=("a", "b"), weights=(0.3, 0.7))
    assert close(fused(weighted, [1.0], [-0.6], weights=[0.3, 0.7]), [-0.6])


def test_only_those_that_agree_count() -> None:
    """Signs +, +, -, +; zeros have no voice."""
    found = fused(Elect(), [1.0, 4.0, -3.0, 0.0], [2.0, -1.0, 1.0, 0.0], [-0.5, 2.0, 0.0, 6.0])
    assert close(found, [1.5, 3.0, -3.0, 6.0])
    summed = fused(Elect(combine="sum"), [1.0, 4.0], [2.0, -1.0], [-0.5, 2.0])
    assert close(summed, [3.0, 6.0])


def test_a_sum_of_zero_takes_the_sign_of_the_majority_or_plus() -> None:
    """Two entries elect minus, one plus, and 1 - 1 takes after them; mergekit says plus."""
    vectors = [[1.0, -2.0, -3.0, 5.0], [-1.0, 0.0, 0.0, 0.0]]
    assert close(fused(Elect(), *vectors), [-1.0, -2.0, -3.0, 5.0])
    assert close(fused(Elect(zero="plus"), *vectors), [1.0, -2.0, -3.0, 5.0])
    assert close(fused(Elect(), [1.0, -2.0, 5.0], [-1.0, 0.0, 0.0]), [0.0, -2.0, 5.0])  # as many of either


def test_rows_trimmed_while_they_are_elected_give_what_trimmed_vectors_give() -> None:
    """Over several pieces, with sums of 0 that wait for the majority, a frozen tensor, and statistics."""
    layout = layout_of(2 * PIECE + 7, 5, statistics=3)
    generator = torch.Generator().manual_seed(0)
    vectors = [(2 * torch.randn(layout.size, generator=generator)).round() for _ in range(4)]
    vectors[1][2 * PIECE + 7 : 2 * PIECE + 12] = 0.0
    rows = [thinned(row(v, str(n)), Trim(0.4), layout, f"{n}t", Thresholds()) for n, v in enumerate(vectors)]
    whole = [read(made, layout) for made in rows]
    out = torch.full((layout.size,), torch.nan)
    fuse(Elect(), rows, layout, out)
    assert torch.equal(out, fused(Elect(), *whole, statistics=3))
    stack = torch.stack(whole)[:, :-3]
    sums = stack.sum(dim=0)
    majority = torch.where(sums == 0, sums.sign().sum().sign(), sums.sign())
    agree = (stack.sign() == majority) & (stack != 0)
    assert bool(((sums == 0) & agree.any(dim=0)).any())
    expected = (stack * agree).sum(dim=0) / agree.sum(dim=0).clamp(min=1)
    assert torch.allclose(out[:-3], expected)


def test_statistics_become_their_mean() -> None:
    vectors = [[1.0, 0.5, -0.25], [-0.5, 0.1, 0.75]]
    information = [torch.tensor([1.0, 9.0, 9.0]), torch.tensor([3.0, 1.0, 1.0])]
    fisher = FisherMean("digest")
    for step, more in ((Elect(), {}), (Mean(), {}), (fisher, {"importances": information})):
        assert close(fused(step, *vectors, statistics=2, **more)[1:], [0.3, 0.25])


def test_fisher_weighs_by_information_and_counts_little_of_it_as_the_floor() -> None:
    information = [torch.tensor([3.0, 0.0, 0.0]), torch.tensor([1.0, 0.0, 2.0])]
    found = fused(FisherMean("digest"), [4.0, 1.0, 5.0], [8.0, 2.0, 1.0], importances=information)
    assert close(found, [(3 * 4 + 8) / 4, 1.5, 1.000002])


VECTORS = st.lists(st.lists(st.floats(-8, 8, width=32), min_size=6, max_size=6), min_size=1, max_size=4)


@given(VECTORS)
def test_where_all_signs_agree_ties_is_the_mean_of_those_that_are_not_zero(
    vectors: list[list[float]],
) -> None:
    positive = torch.tensor(vectors).abs()
    voices = (positive > 0).sum(dim=0).clamp(min=1)
    assert torch.allclose(fused(Elect(), *positive), positive.sum(dim=0) / voices, rtol=1e-5)


@given(VECTORS)
def test_equal_information_is_the_uniform_mean(vectors: list[list[float]]) -> None:
    information = [torch.full((6,), 0.37) for _ in vectors]
    fisher = fused(FisherMean("digest"), *vectors, importances=information)
    assert torch.allclose(fisher, fused(Mean(), *vectors), atol=1e-5)
    assert torch.allclose(fused(Mean(), *vectors), torch.tensor(vectors).mean(dim=0), atol=1e-5)


@given(VECTORS)
def test_negated_vectors_elect_the_negative(vectors: list[list[float]]) -> None:
    negative = [[-value for value in vector] for vector in vectors]
    assert torch.allclose(fused(Elect(), *negative), -fused(Elect(), *vectors), atol=1e-6)


@given(VECTORS)
def test_an_elected_entry_lies_among_those_it_was_elected_from(vectors: list[list[float]]) -> None:
    found, stack = fused(Elect(), *vectors), torch.tensor(vectors)
    assert torch.isfinite(found).all()
    assert bool((found.abs() <= stack.abs().max(dim=0).values * (1 + 1e-6)).all())


@given(VECTORS)
def test_signs_and_means_are_those_of_the_formula(vectors: list[list[float]]) -> None:
    """TIES, steps 2 and 3, written plainly in float64, apart from sums within rounding of 0."""
    stack = np.array(vectors, dtype=np.float64)
    sums = stack.sum(axis=0)
    agree = np.sign(stack) == np.sign(sums)
    expected = (stack * agree).sum(axis=0) / np.maximum(agree.sum(axis=0), 1)
    clear = np.abs(sums) > 1e-4
    assert fused(Elect(), *vectors).numpy()[clear] == pytest.approx(expected[clear], rel=1e-4, abs=1e-6)


# Records


def test_steps_come_back_from_json_values() -> None:
    steps = (
        Trim(0.3, per="tensor"),
        Drop(0.5, seed=4, rescale="norm"),
        Elect("t", ("a", "b"), "plus", "sum", (0.5, 1.5)),
        Mean("m", ("a",)),
        FisherMean("digest", on="eth3d"),
    )
    assert from_dicts(as_dicts(steps)) == steps


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Trim(0.0), "trim: found density 0.0, expected a number above 0 and at most 1"),
        (lambda: Trim(0.2, per="block"), "expected one of: tensor, vector"),
        (lambda: Drop(1.0), r"drop: found probability 1.0, expected it in \[0, 1\)"),
        (lambda: Drop(0.5, seed=-1), "found seed -1"),
        (lambda: Elect(zero="minus"), "'minus', expected one of: majority, plus"),
        (lambda: Elect(weights=(0.5,)), "found 1 weights for 0 sources"),
        (lambda: FisherMean("d", floor=0.0), "fisher: found floor 0.0"),
        (lambda: from_dicts([{"step": "prune"}], "r.json"), "r.json: preparation step"),
        (lambda: from_dicts([{"step": "trim", "densty": 1}]), "did you mean 'density'"),
        (lambda: from_dicts([{"step": "trim", "density": "x"}], "r.json"), "r.json: trim: found density 'x'"),
        (lambda: from_dicts([{"step": "fisher"}], "r.json"), "r.json: the step 'fisher' is malformed"),
        (lambda: from_dicts("trim"), "expected a list of steps"),
    ],
)
def test_what_makes_no_sense_is_refused(make: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()  # type: ignore[operator]
