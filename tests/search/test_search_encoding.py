"""The vector of Stage 2 against the paper's formulas, written out independently."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from search_landscapes import BLOCKS, names

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe, routed
from sfkit.search import Encoding, mean_entropy
from sfkit.search.encoding import scale_of, softmax

SOURCES = names(5)
reals = st.floats(-8, 8)


@st.composite
def encodings(draw: st.DrawFn) -> Encoding:
    tied, scaled = draw(st.booleans()), draw(st.booleans())
    frozen = draw(st.sets(st.sampled_from(BLOCKS), max_size=len(BLOCKS) - 1))
    half = draw(st.floats(0.05, 1.0))
    sources = names(draw(st.integers(2, 6)))
    rank = None if tied else draw(st.sampled_from((None, 1, 2, 3)))
    return Encoding(sources, BLOCKS, (1.0 - half, 1.0 + half), tied, scaled, tuple(sorted(frozen)), rank)


@st.composite
def vectors(draw: st.DrawFn) -> tuple[Encoding, np.ndarray]:
    encoding = draw(encodings())
    size = encoding.dimension
    return encoding, np.array(draw(st.lists(reals, min_size=size, max_size=size)))


@given(encodings())
def test_zero_is_exactly_the_equal_weight_merge(encoding: Encoding) -> None:
    assert encoding.decode(np.zeros(encoding.dimension)) == Recipe.equal(encoding.sources, BLOCKS)


def test_dimensions_are_the_papers() -> None:
    five, four = names(5), ("backbone", "neck", "volume", "head")
    assert Encoding(five, four).dimension == 9
    assert Encoding(five, four, tied=False).dimension == 5 * 4 + 4
    assert Encoding(five, four, scaled=False).dimension == 5
    assert Encoding(five, four, frozen=("neck",)).dimension == 8
    assert Encoding(five, four, tied=False, rank=1).dimension == 5 + (4 + 5) + 4
    assert Encoding(five, four, tied=False, frozen=("neck",)).dimension == 5 * 3 + 3


@given(st.lists(reals, min_size=2, max_size=6))
def test_softmax_is_equation_10(logits: list[float]) -> None:
    total = sum(math.exp(w) for w in logits)
    assert softmax(np.array(logits)) == pytest.approx([math.exp(w) / total for w in logits], rel=1e-12)


@given(reals)
def test_scale_is_equation_11(s: float) -> None:
    assert scale_of(s, (0.25, 1.75)) == pytest.approx(0.25 + 1.5 / (1 + math.exp(-s)), rel=1e-12)


def test_huge_variables_neither_overflow_nor_leave_the_bounds() -> None:
    assert scale_of(-1e9, (0.25, 1.75)) == 0.25
    assert scale_of(1e9, (0.25, 1.75)) == 1.75
    assert softmax(np.array([1e6, 0.0, -1e6])) == (1.0, 0.0, 0.0)


def test_decode_by_hand() -> None:
    encoding = Encoding(("a", "b"), ("x", "y"), tied=False, frozen=("x",))
    recipe = encoding.decode(np.array([math.log(3.0), 0.0, math.log(2.0)]))
    assert recipe.weights[0] == (0.5, 0.5)
    assert recipe.weights[1] == pytest.approx((0.75, 0.25))
    assert recipe.scales == (1.0, pytest.approx(0.25 + 1.5 * 2 / 3))


def test_blocks_take_their_entries_in_order() -> None:
    tied = Encoding(("a", "b"), ("x", "y", "z"), frozen=("y",)).decode(np.array([0.0, 0.0, 1.0, -1.0]))
    assert tied.scales[0] > 1.0 == tied.scales[1] > tied.scales[2]
    untied = Encoding(("a", "b"), ("x", "y"), tied=False, scaled=False)
    recipe = untied.decode(np.array([1.0, 0.0, 0.0, 2.0]))
    assert recipe.weights[0][0] > 0.5 > recipe.weights[1][0]
    assert recipe.scales == (1.0, 1.0)


@given(vectors())
def test_every_vector_is_a_recipe_within_the_bounds(case: tuple[Encoding, np.ndarray]) -> None:
    encoding, x = case
    recipe = encoding.decode(x)
    low, high = encoding.gamma
    for block, row, scale in zip(recipe.blocks, recipe.weights, recipe.scales, strict=True):
        assert math.fsum(row) == pytest.approx(1.0, abs=1e-12)
        assert low <= scale <= high
        if block in encoding.frozen or not encoding.scaled:
            assert scale == 1.0
    assert recipe.tied or not encoding.tied
    assert encoding.admit(recipe) == recipe


@given(vectors())
def test_encode_inverts_decode(case: tuple[Encoding, np.ndarray]) -> None:
    encoding, x = case
    if encoding.rank is not None:
        x = x / 4.0  # products of two entries: as far from the floor as the others
    recipe = encoding.decode(x)
    again = encoding.decode(encoding.encode(recipe, floor=1e-9))
    for row, row_again in zip(recipe.weights, again.weights, strict=True):
        assert row_again == pytest.approx(row, abs=1e-7)
    assert again.scales == pytest.approx(recipe.scales, abs=1e-7)


@given(st.integers(2, 5), st.integers(2, 5), st.data())
def test_full_rank_reproduces_block_specific_routing(sources: int, blocks: int, data: st.DataObject) -> None:
    """R = min(B, E) - 1 directions beside the shared row reach every W, since rows may share a mean."""
    names_, blocks_ = names(sources), tuple(f"block{n}" for n in range(blocks))
    free = Encoding(names_, blocks_, tied=False)
    x = np.array(data.draw(st.lists(st.floats(-4, 4), min_size=free.dimension, max_size=free.dimension)))
    recipe = free.decode(x)
    low = Encoding(names_, blocks_, tied=False, rank=min(sources, blocks) - 1)
    again = low.decode(low.encode(recipe, floor=1e-9))
    for row, row_again in zip(recipe.weights, again.weights, strict=True):
        assert row_again == pytest.approx(row, abs=1e-7)
    assert again.scales == pytest.approx(recipe.scales, abs=1e-7)


def test_low_rank_logits_by_hand() -> None:
    encoding = Encoding(("a", "b", "c"), ("x", "y"), tied=False, rank=1, scaled=False)
    assert encoding.dimension == 3 + (2 + 3)
    x = np.array([1.0, 2.0, 3.0, 10.0, -1.0, 0.5, 0.0, 2.0])
    assert encoding.logits(x).tolist() == [[6.0, 2.0, 23.0], [0.5, 2.0, 1.0]]
    frozen = Encoding(("a", "b", "c"), ("x", "y", "z"), tied=False, rank=2, frozen=("y",))
    assert frozen.dimension == 3 + 2 * (2 + 3) + 2


def test_too_low_a_rank_gives_the_nearest_logits() -> None:
    encoding = Encoding(("a", "b", "c"), ("x", "y", "z"), tied=False, rank=1, scaled=False)
    rng = np.random.default_rng(5)
    recipe = routed(encoding.sources, encoding.blocks, rng.dirichlet((2.0, 2.0, 2.0), 3).tolist())
    wanted = np.log(np.array(recipe.weights))
    wanted -= wanted.mean(axis=1, keepdims=True)
    error = np.linalg.norm(encoding.logits(encoding.encode(recipe, floor=1e-9)) - wanted)
    residual = wanted - wanted.mean(axis=0)
    assert error == pytest.approx(np.linalg.svd(residual, compute_uv=False)[1], rel=1e-6)


def test_encode_brings_the_boundary_within_reach() -> None:
    encoding = Encoding(("a", "b", "c"), ("x", "y"))
    recipe = routed(("a", "b", "c"), ("x", "y"), [(1.0, 0.0, 0.0)] * 2, (0.25, 1.75))
    x = encoding.encode(recipe, floor=0.01)
    assert x[:3].sum() == pytest.approx(0.0)
    assert x[0] - x[1] == pytest.approx(math.log(100))
    assert encoding.decode(x).scales == pytest.approx((0.25 + 0.015, 1.75 - 0.015))


def test_encode_of_the_equal_merge_is_zero() -> None:
    encoding = Encoding(SOURCES, BLOCKS)
    assert encoding.encode(Recipe.equal(SOURCES, BLOCKS)) == pytest.approx(np.zeros(8), abs=1e-15)


def test_admit_reorders_and_fills_up() -> None:
    encoding = Encoding(("a", "b", "c"), ("x", "y"), tied=False)
    given_ = Recipe(("c", "a"), ("y", "x"), ((0.25, 0.75), (1.0, 0.0)), (1.5, 0.5))
    admitted = encoding.admit(given_)
    assert (admitted.sources, admitted.blocks) == (("a", "b", "c"), ("x", "y"))
    assert admitted.weights == ((0.0, 0.0, 1.0), (0.75, 0.0, 0.25))
    assert admitted.scales == (0.5, 1.5)


@pytest.mark.parametrize(
    ("recipe", "options", "expected"),
    [
        (Recipe.equal(("a", "z"), ("x", "y")), {}, "start: unknown source 'z'"),
        (Recipe.equal(("a", "b"), ("x",)), {}, r"start: found blocks \['x'\], expected \['x', 'y'\]"),
        (Recipe(("a", "b"), ("x", "y"), ((1, 0), (0, 1)), (1, 1)), {}, "weights that differ between blocks"),
        (
            Recipe.weighted({"a": 0.5, "b": 0.4}, ("x", "y")),
            {},
            "'x' has weights that sum to 0.9, expected 1",
        ),
        (
            Recipe.weighted({"a": 0.5, "b": 0.5}, ("x", "y"), scale=2.0),
            {},
            r"the scale 2, expected it in \[0.25",
        ),
        (
            Recipe.weighted({"a": 0.5, "b": 0.5}, ("x", "y"), scale=1.5),
            {"frozen": ("y",)},
            r"'y' has the scale 1.5, expected it in \[1, 1\]",
        ),
        (
            Recipe.weighted({"a": 0.5, "b": 0.5}, ("x", "y"), scale=1.5),
            {"scaled": False},
            r"'x' has the scale 1.5, expected it in \[1, 1\]",
        ),
        (
            Recipe.weighted({"a": 0.7, "b": 0.3}, ("x", "y")),
            {"frozen": ("x",), "tied": False},
            "'x' is frozen but has weights",
        ),
    ],
)
def test_a_recipe_the_encoding_cannot_express_is_refused(recipe, options, expected) -> None:
    with pytest.raises(InputError, match=expected):
        Encoding(("a", "b"), ("x", "y"), **options).admit(recipe)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"sources": ("a",)}, r"sources: found \['a'\], expected at least two"),
        ({"gamma": (0.5, 1.2)}, r"gamma: found \[0.5, 1.2\], expected bounds around 1 with 1 in the middle"),
        ({"gamma": (1.0, 1.0)}, "expected bounds around 1"),
        ({"gamma": (-0.5, 2.5)}, "gamma: found -0.5, expected a finite number of at least 0"),
        ({"gamma": (0.5,)}, "gamma: found .*expected two numbers"),
        ({"gamma": 1.5}, "gamma: found 1.5, expected two numbers"),
        ({"rank": 1}, "rank: found 1 and tied=True, expected tied=False"),
        ({"rank": 0, "tied": False}, "rank: found 0, expected a whole number of at least 1"),
        ({"frozen": ("z",)}, "frozen_blocks: unknown block 'z'"),
        ({"frozen": ("x", "y"), "tied": False}, "frozen_blocks: found every block"),
    ],
)
def test_an_encoding_that_makes_no_sense_is_refused(options, expected) -> None:
    with pytest.raises(InputError, match=expected):
        Encoding(**{"sources": ("a", "b"), "blocks": ("x", "y"), **options})


def test_entropy_by_hand() -> None:
    recipe = routed(("a", "b", "c", "d"), ("x", "y"), [(0.25,) * 4, (0.5, 0.5, 0.0, 0.0)])
    assert mean_entropy(recipe) == pytest.approx((math.log(4) + math.log(2)) / 2)
    assert mean_entropy(routed(("a", "b"), ("x",), [(1.0, 0.0)])) == 0.0
