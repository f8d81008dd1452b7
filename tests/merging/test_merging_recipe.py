"""Recipes: what they refuse, what decides their key, and that JSON keeps them exactly."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe, routed

BLOCKS = ("one", "two")
IDENTITY = {"a": "f3", "b": "f1", "c": "f2"}
weight = st.floats(0, 10, allow_subnormal=False)


@given(
    rows=st.lists(st.tuples(weight, weight, weight), min_size=2, max_size=2), scales=st.tuples(weight, weight)
)
def test_json_keeps_every_bit(rows: list[tuple[float, float, float]], scales: tuple[float, float]) -> None:
    recipe = Recipe(("a", "b", "c"), BLOCKS, tuple(rows), scales)
    assert Recipe.from_json(recipe.to_json()) == recipe


@given(order=st.permutations(["a", "b", "c"]))
def test_the_order_of_sources_does_not_matter(order: list[str]) -> None:
    weights = {"a": 0.2, "b": 0.3, "c": 0.5}
    recipe = Recipe.weighted({name: weights[name] for name in order}, BLOCKS)
    assert recipe.canonical(IDENTITY, "p") == {"sources": ["f1", "f2", "f3"], "weights": [0.3, 0.5, 0.2]}


def test_sources_without_weight_are_no_part_of_the_key() -> None:
    with_zero = Recipe.weighted({"a": 0.5, "b": 0.5, "c": 0.0}, BLOCKS)
    assert with_zero.canonical(IDENTITY, "p") == Recipe.equal(["b", "a"], BLOCKS).canonical(IDENTITY, "p")
    assert Recipe.weighted({"a": 0.0}, BLOCKS).canonical(IDENTITY, "p") == {"sources": []}


def test_blocks_matter_only_where_they_differ() -> None:
    tied = Recipe.equal(["a", "b"], BLOCKS)
    scaled = routed(["a", "b"], BLOCKS, [[0.5, 0.5]] * 2, [1.0, 1.25])
    assert "partition" not in tied.canonical(IDENTITY, "p")
    assert scaled.canonical(IDENTITY, "p")["partition"] == "p"


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Recipe(("a", "a"), ("x",), ((0.5, 0.5),), (1.0,)), "name one twice"),
        (lambda: Recipe(("a",), (), (), ()), "expected at least one"),
        (lambda: Recipe(("a",), ("x",), ((0.5, 0.5),), (1.0,)), "rows of lengths"),
        (lambda: Recipe(("a",), ("x",), ((0.5,),), (1.0, 2.0)), "2 scales"),
        (lambda: Recipe(("a",), ("x",), ((-0.5,),), (1.0,)), "found the value -0.5"),
        (lambda: Recipe(("a",), ("x",), ((float("nan"),),), (1.0,)), "found the value nan"),
        (lambda: routed(["a", "b"], ["x"], [[0.5, 0.6]]), "sum to 1.1"),
        (lambda: Recipe.from_json("[]", where="r.json"), "r.json: found a JSON list"),
        (lambda: Recipe.from_json("{", where="r.json"), "r.json: not JSON"),
        (lambda: Recipe.from_json("{}", where="r.json"), "found format None"),
        (lambda: Recipe.equal(["a"], ["x"]).of("y"), "unknown block 'y'"),
    ],
)
def test_refusals(build: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()  # type: ignore[operator]


def test_a_missing_entry_is_named() -> None:
    values = Recipe.equal(["a"], BLOCKS).as_dict()
    del values["weights"]["two"]
    with pytest.raises(InputError, match="the entry 'two' is missing"):
        Recipe.from_json(json.dumps(values))
