"""Constraints and subset transfer: what is refused, and in which words."""

from __future__ import annotations

import pytest
from search_landscapes import BLOCKS, names

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe
from sfkit.search import Constraints, subset_of, transfer


def test_no_constraints_leave_everything() -> None:
    space = Constraints().space(names(4), BLOCKS)
    assert (space.allowed, space.required, space.largest) == ((0, 1, 2, 3), frozenset(), 4)


def test_names_become_indices() -> None:
    limits = Constraints(include=["source3"], exclude=["source0"], largest=9)
    space = limits.space(names(5), BLOCKS)
    assert (space.allowed, space.required, space.largest) == ((1, 2, 3, 4), frozenset({3}), 4)
    assert limits.include == ("source3",)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"include": ("sorce1",)}, "include: unknown source 'sorce1'.*did you mean 'source1'"),
        ({"exclude": ("x",)}, "exclude: unknown source 'x', expected one of: source0, source1, source2"),
        ({"frozen_blocks": ("hed",)}, "frozen_blocks: unknown block 'hed'.*did you mean 'head'"),
        ({"exclude": ("source0", "source1")}, r"sources: found 1 that may take part \(2 excluded\)"),
    ],
)
def test_constraints_that_do_not_fit_the_pool_are_refused(options, expected) -> None:
    with pytest.raises(InputError, match=expected):
        Constraints(**options).space(names(3), BLOCKS)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"include": ("a",), "exclude": ("a",)}, "include: 'a' is also in exclude"),
        ({"largest": 1}, "largest: found 1, expected a whole number of at least 2"),
        ({"include": ("a", "b", "c"), "largest": 2}, "largest: found 2, expected at least 3"),
        ({"include": "abc"}, r"include: found the text 'abc', expected a list of names: write \['abc'\]"),
        ({"exclude": ("a", "a")}, "exclude: found 'a' more than once"),
    ],
)
def test_constraints_that_contradict_themselves_are_refused(options, expected) -> None:
    with pytest.raises(InputError, match=expected):
        Constraints(**options)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"include": ("source9",)}, "include: unknown source 'source9'"),
        ({"exclude": ("source1",)}, "sources: found 'source1', which exclude forbids"),
        ({"largest": 2}, r"sources: found 3, expected at most 2 \(largest\)"),
        ({"frozen_blocks": ("neck",)}, "frozen_blocks: unknown block 'neck'"),
    ],
)
def test_a_subset_that_breaks_the_constraints_is_refused(options, expected) -> None:
    with pytest.raises(InputError, match=expected):
        Constraints(**options).check_subset(names(3), BLOCKS)


def test_a_subset_that_keeps_them_passes() -> None:
    limits = Constraints(include=("source1",), exclude=("source7",), largest=3, frozen_blocks=("head",))
    limits.check_subset(names(3), BLOCKS)


def test_the_subset_of_a_recipe_is_what_weighs_something() -> None:
    recipe = Recipe(("a", "b", "c"), ("x", "y"), ((1.0, 0.0, 0.0), (0.5, 0.0, 0.5)), (1.0, 1.0))
    assert subset_of(recipe) == ("a", "c")
    assert subset_of(["c", "b"]) == ("c", "b")


def test_transfer_keeps_names_in_the_other_pools_order() -> None:
    recipe = Recipe.equal(("sceneflow", "kitti", "sintel"), BLOCKS)
    assert transfer(recipe, ["sintel", "crestereo", "kitti", "sceneflow"]) == ("sintel", "kitti", "sceneflow")
    assert transfer(("kitti",), ("kitti", "sintel")) == ("kitti",)


def test_transfer_refuses_a_pool_without_the_source() -> None:
    with pytest.raises(InputError, match=r"subset: unknown source 'sintel'.*did you mean 'sintel_v2'"):
        transfer(("kitti", "sintel"), ("kitti", "sintel_v2"))
    with pytest.raises(InputError, match="subset: found the text 'kitti'"):
        transfer("kitti", ("kitti", "sintel"))
