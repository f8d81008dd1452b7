"""Stage 2's guards that need no images: shrinkage towards Stage 1, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from search_landscapes import BLOCKS, Scorer, names

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe
from sfkit.search import Encoding, RoutingSearch, RoutingSettings


def test_distance_by_hand() -> None:
    encoding = Encoding(("a", "b"), ("x", "y"))
    assert encoding.distance(np.zeros(4)) == 0.0
    # Logits 3 and 1 are 1 and -1 less their mean; scale variables 2 and 0: (1 + 1 + 4) / 4.
    assert encoding.distance(np.array([3.0, 1.0, 2.0, 0.0])) == 1.5
    same = [encoding.decode(np.array(x)) for x in ([3.0, 1.0, 2.0, 0.0], [103.0, 101.0, 2.0, 0.0])]
    assert same[0].weights[0] == pytest.approx(same[1].weights[0])
    assert encoding.distance(np.array([103.0, 101.0, 2.0, 0.0])) == pytest.approx(1.5)


def test_shrinkage_is_a_share_of_what_x_0_scores() -> None:
    sources = names(4)
    settings = RoutingSettings(evaluations=40, shrinkage=0.1, entropy=0.0)
    search = RoutingSearch(sources, BLOCKS, Scorer(lambda recipe: 20.0), settings)
    best = search.run()
    for candidate in search.candidates:
        expected = 0.1 * 20.0 * search.encoding.distance(np.array(candidate.x))
        assert candidate.penalty == pytest.approx(expected)
        assert candidate.fitness == pytest.approx(20.0 + expected)
    assert best.number == 0


def test_more_shrinkage_stays_nearer_to_stage_1() -> None:
    def landscape(recipe: Recipe) -> float:
        return 10.0 + sum(abs(scale - 1.5) for scale in recipe.scales)

    found = []
    for shrinkage in (0.0, 0.02, 0.5):
        settings = RoutingSettings(evaluations=300, shrinkage=shrinkage)
        search = RoutingSearch(names(3), BLOCKS, Scorer(landscape), settings)
        found.append(search.encoding.distance(np.array(search.run().x)))
    assert found[0] > found[1] + 0.05 > found[2]


def test_a_broken_x_0_asks_for_no_shrinkage() -> None:
    equal = Recipe.equal(names(3), BLOCKS)
    scorer = Scorer(lambda recipe: math.inf if recipe == equal else 5.0)
    search = RoutingSearch(names(3), BLOCKS, scorer, RoutingSettings(evaluations=30, shrinkage=0.3))
    assert search.run().fitness == 5.0


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"holdout": 1.5}, "holdout: found 1.5, expected 0 for none"),
        ({"shrinkage": -0.1}, "shrinkage: found -0.1, expected a finite number of at least 0"),
    ],
)
def test_guards_out_of_range_are_refused(options: dict[str, float], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        RoutingSettings(**options)


def test_a_function_cannot_hold_pairs_out() -> None:
    with pytest.raises(InputError, match="holdout: found a scorer of the kind Scorer"):
        RoutingSearch(names(3), BLOCKS, Scorer(lambda recipe: 1.0), RoutingSettings(holdout=0.5))
