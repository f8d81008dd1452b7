"""The verdict on constructed studies whose truth is known: Stage 2 better, worse on unseen, no different."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from measured_records import measured

from sfkit.analysis.measured import Measured
from sfkit.analysis.verdict import Support, estimate_between, simplicity, verdict
from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe
from sfkit.merging.steps import Trim

BLOCKS = ("neck", "head")
ROUTED = Recipe(("a", "b"), BLOCKS, ((0.7, 0.3), (0.2, 0.8)), (1.1, 0.9))
RECIPES: Mapping[str, Recipe] = {
    "base": Recipe.base(BLOCKS),
    "a": Recipe.equal(["a"], BLOCKS),
    "uniform": Recipe.equal(["a", "b", "c"], BLOCKS),
    "Stage 1": Recipe.equal(["a", "b"], BLOCKS),
    "Stage 1+2": ROUTED,
}
LEVELS = {"base": 40.0, "a": 33.0, "uniform": 32.0, "Stage 1": 30.0}


def bench(
    name: str, routed: float, images: int = 20, *, guides: bool = False, noise: float = 1.0, **levels: float
) -> Measured:
    """Images that are hard for all networks alike; Stage 1+2 is ``routed`` points off Stage 1."""
    rng = np.random.default_rng([images, *name.encode()])
    hard = rng.normal(0.0, 8.0, images)
    rows = {}
    for network, level in {**LEVELS, **levels, "Stage 1+2": LEVELS["Stage 1"] + routed}.items():
        own = rng.normal(0.0, noise, images)
        own -= own.mean()  # so that the level is the truth
        rows[network] = [round(1000 * float(x)) for x in level + hard + own]
    return measured(rows, pixels=[100_000] * images, name=name, validation=guides)


def test_a_stage_2_that_is_better_everywhere_is_deployed_and_the_tests_say_so() -> None:
    found = verdict(RECIPES, [bench("guide", -3.0, guides=True)], [bench("one", -2.5), bench("two", -2.0)])
    assert (found.recommended, found.support, found.simplest) == ("Stage 1+2", Support.SHOWN, None)
    assert found.reason[0].startswith("Deploy Stage 1+2: bad-3.0 ")
    assert "on guide (20 pairs), chosen among 5 networks there" in found.reason[0]
    assert "better than Stage 1: -2.2" in found.sentence


def test_a_simpler_network_that_tests_put_ahead_is_named_though_they_do_not_tell_it_apart() -> None:
    """Better than the nearest simpler network is no support where a source alone does better still."""
    tests = [bench("one", -2.0, a=27.9), bench("two", -2.0, a=27.8)]
    found = verdict(RECIPES, [bench("guide", -3.0, guides=True)], tests)
    assert (found.recommended, found.support) == ("Stage 1+2", Support.UNDECIDED)
    assert "better than Stage 1: -2.0" in found.sentence
    assert "There a, which is simpler too, scores lower, though the tests do not tell" in found.sentence
    assert "apart: +0.15 points" in found.sentence


def test_a_stage_2_that_is_worse_on_unseen_is_overruled_in_the_first_sentence() -> None:
    tests = [bench("one", +2.5), bench("two", +2.0)]
    found = verdict(RECIPES, [bench("guide", -3.0, guides=True)], tests)
    assert (found.recommended, found.preferred) == ("Stage 1", "Stage 1+2")
    assert found.support is Support.OVERRULED
    assert found.reason[0] == "Stage 2 is not supported here: take Stage 1."
    assert "Stage 1+2 scores lowest on guide (20 pairs), which chose it" in found.reason[1]
    assert "worse than Stage 1 by +2.2" in found.reason[1]
    assert found.score == pytest.approx(tests[0].score("Stage 1"), abs=5.0)
    assert found.as_dict()["recommended"] == "Stage 1"


def test_a_stage_2_that_cannot_be_told_apart_is_said_to_be_so() -> None:
    guide = bench("guide", -0.02, guides=True, noise=2.0)
    found = verdict(
        RECIPES,
        [guide],
        [bench("one", 0.05), bench("two", -0.1)],
        evaluations={
            "Stage 1": 180,
            "Stage 1+2": 480,
        },
    )
    assert (found.recommended, found.support, found.simplest) == ("Stage 1+2", Support.UNDECIDED, "Stage 1")
    assert "Validation cannot tell it from Stage 1, which is simpler (-0.02 points" in found.sentence
    assert "it is not told apart from Stage 1" in found.sentence
    assert found.reason[-1] == "Finding Stage 1+2 took 300 evaluations more than Stage 1."


MEAN = Recipe(("a", "b", "c"), BLOCKS, ((0.6, 0.3, 0.1), (0.3, 0.6, 0.1)), (1.05, 0.95))


def averaging(name: str, *, routed: float, mean: float, images: int = 20, guides: bool = False) -> Measured:
    """As :func:`bench`, with an averaged winner ``mean`` points off Stage 1, by 2 points more or less."""
    found = bench(name, routed, images, guides=guides)
    shifted = bench(name, mean, images, guides=guides, noise=3.0).images["Stage 1+2"]
    return replace(found, images={**found.images, "average": shifted})


def test_an_averaged_winner_goes_before_what_scores_lowest() -> None:
    recipes = {**RECIPES, "average": MEAN}
    guide = averaging("guide", routed=-3.0, mean=-2.5, guides=True)
    found = verdict(recipes, [guide], averaged="average")
    assert (found.recommended, found.preferred, found.lowest) == ("average", "average", "Stage 1+2")
    assert found.reason[0].startswith("Deploy average: bad-3.0 ")
    assert found.reason[0].endswith("on guide (20 pairs), the average of what wins resamples of these pairs.")
    assert found.reason[1].startswith("Stage 1+2 scores lowest there (bad-3.0 ")
    lower = averaging("guide", routed=-2.5, mean=-3.0, guides=True)
    assert "It also scores lowest there, among 6" in verdict(recipes, [lower], averaged="average").sentence
    assert verdict(RECIPES, [guide], averaged="average").recommended == "Stage 1+2", "there is none"
    assert verdict(recipes, [guide]).recommended == "Stage 1+2", "it is one of many unless named"


def test_tests_overrule_an_averaged_winner_for_what_scores_lowest() -> None:
    guide = averaging("guide", routed=-3.0, mean=-2.5, guides=True)
    tests = [averaging(name, routed=-4.0, mean=-1.0, images=40) for name in ("one", "two")]
    found = verdict({**RECIPES, "average": MEAN}, [guide], tests, averaged="average")
    assert (found.recommended, found.support) == ("Stage 1+2", Support.OVERRULED)
    assert found.reason[0] == "average is not supported here: take Stage 1+2."
    assert found.reason[1].startswith("average averages what wins resamples of guide (20 pairs), but on what")


def test_an_average_that_validation_shows_worse_is_passed_over_unless_tests_say_otherwise() -> None:
    recipes = {**RECIPES, "average": MEAN}
    guide = averaging("guide", routed=-3.0, mean=+2.0, guides=True)
    found = verdict(recipes, [guide], averaged="average")
    assert (found.recommended, found.averaged, found.passed_over) == ("Stage 1+2", False, "average")
    assert found.reason[0].startswith("Deploy Stage 1+2: bad-3.0 ")
    assert found.reason[1].startswith(
        "average, the average of what wins resamples of these pairs, is passed over: validation shows "
        "Stage 1+2 better (-5.00 points, 95 % interval -"
    )
    tests = [averaging(name, routed=-1.0, mean=-4.0, images=40) for name in ("one", "two")]
    overruled = verdict(recipes, [guide], tests, averaged="average")
    assert (overruled.recommended, overruled.support) == ("average", Support.OVERRULED)
    assert overruled.reason[0] == "Stage 2 is not supported here: take average."


def test_a_simpler_network_that_validation_prefers_to_the_average_is_said_to_score_lower() -> None:
    """Stage 1+2 scores lowest by luck on some pairs, which shows nothing; Stage 1 is better on each."""
    rows = {"Stage 1": [31, 31, 30, 31, 30, 31], "average": [33, 33, 32, 33, 32, 34]}
    rows["Stage 1+2"] = [10, 40, 40, 10, 40, 40]
    recipes = {**{name: RECIPES[name] for name in ("Stage 1", "Stage 1+2")}, "average": MEAN}
    found = verdict(recipes, [measured(rows, validation=True)], averaged="average")
    assert (found.recommended, found.lowest, found.simplest) == ("average", "Stage 1+2", "Stage 1")
    assert "On validation Stage 1, which is simpler, scores lower (+2.17 points" in found.sentence


def test_more_than_a_standard_error_is_no_proof_where_the_interval_holds_0() -> None:
    """0.6 +- 0.4 points: more than one standard error, and an interval from -1.71 to 0.51."""
    rows = {"Stage 1": [31, 31, 30, 31, 30], "Stage 1+2": [30, 30, 31, 30, 29]}
    recipes = {name: RECIPES[name] for name in rows}
    found = verdict(recipes, [measured(rows, validation=True)])
    assert found.simplest is None
    assert (
        "Every simpler network is more than one standard error behind it on validation, which is a hint and "
        "no proof; the nearest is Stage 1 (-0.60 points, 95 % interval -1.71 to +0.51)." in found.sentence
    )
    rows["Stage 1+2"] = [28, 27, 27, 28, 26]
    clear = verdict(recipes, [measured(rows, validation=True)])
    assert (
        "Validation tells it from every simpler network, the nearest being Stage 1 (-3.40" in clear.sentence
    )


def test_the_simplest_of_those_within_one_standard_error_is_named() -> None:
    rows = {"a": [30, 31, 33, 30, 31], "Stage 1": [31, 31, 32, 30, 31], "Stage 1+2": [30, 31, 32, 31, 30]}
    guide = measured(rows, validation=True)
    found = verdict({name: RECIPES[name] for name in rows}, [guide])
    assert found.simplest == "a"  # 0.2 +- 0.37 points from the best: a source alone is simplest
    assert found.tests == ()
    assert "No benchmark is left that guided nothing" in found.sentence


def test_benchmarks_on_which_the_simpler_network_failed_are_not_said_to_be_missing() -> None:
    rows = {"Stage 1": [31, 31, 32, 30, 31], "Stage 1+2": [30, 31, 32, 31, 30]}
    recipes = {name: RECIPES[name] for name in rows}
    failed = measured({**rows, "Stage 1": []}, name="unseen")
    found = verdict(recipes, [measured(rows, validation=True)], [failed])
    assert (found.simplest, found.support, found.tests) == ("Stage 1", Support.UNDECIDED, ("unseen",))
    assert "On what guided nothing (unseen) one of the two has no score everywhere" in found.sentence
    assert "No benchmark is left" not in found.sentence


def test_one_pair_tells_nothing_apart() -> None:
    guide = measured({"Stage 1": [30], "Stage 1+2": [20]}, validation=True)
    recipes = {name: RECIPES[name] for name in ("Stage 1", "Stage 1+2")}
    found = verdict(recipes, [guide], [bench("one", 0.0)])
    assert (found.recommended, found.simplest) == ("Stage 1+2", "Stage 1")
    assert "So few pairs cannot tell it from Stage 1, which is simpler (-10.00 points, no interval" in (
        found.sentence
    )
    assert "on one (1 pair)" in found.sentence


def test_four_test_images_overrule_nothing() -> None:
    found = verdict(RECIPES, [bench("guide", -3.0, guides=True)], [bench("one", +9.0, images=4)])
    assert found.support is Support.UNDECIDED
    assert found.recommended == "Stage 1+2"
    assert math.isnan(found.against("Stage 1").p)
    assert "not told apart from Stage 1: +9.00 points, no interval from so few pairs." in found.sentence


def test_four_pairs_show_no_average_worse() -> None:
    guide = averaging("guide", routed=-3.0, mean=+9.0, images=4, guides=True)
    assert estimate_between([guide], "average", "Stage 1+2").interval()[0] > 0.0  # type: ignore[union-attr]
    found = verdict({**RECIPES, "average": MEAN}, [guide], averaged="average")
    assert (found.recommended, found.passed_over) == ("average", None)


def test_what_is_compared_beside_it_makes_a_verdict_no_surer() -> None:
    """One interval leaves 0 out; as one of many comparisons it shows nothing, and that is said."""
    guide, tests = bench("guide", -3.0, guides=True), [bench("one", -0.9, noise=1.2)]
    alone = verdict(RECIPES, [guide], tests)
    against = alone.against("Stage 1")
    assert against.tests is not None
    assert against.tests.interval()[1] < 0.0
    assert "better than Stage 1: -0.9" in alone.sentence
    among = verdict(RECIPES, [guide], tests, beside=[0.9] * 40)
    assert (alone.family, among.family) == (4, 44)
    assert among.p_values == alone.p_values
    assert among.against("Stage 1").p > 0.05 > against.p
    assert f"{against.tests.interval()[1]:+.2f}, one of 44 comparisons." in among.sentence
    assert "not told apart from Stage 1: -0.9" in among.sentence


def test_with_no_truth_in_it_tests_overrule_in_at_most_five_percent() -> None:
    # All networks are equally good; validation prefers one by luck, ten simpler ones are compared with it.
    rng = np.random.default_rng(0)
    names = [f"s{n}" for n in range(10)]
    recipes = {**{name: Recipe.equal([name], BLOCKS) for name in names}, "routed": ROUTED}
    overruled = 0
    for _ in range(200):

        def drawn(name: str, lucky: float, images: int = 12) -> Measured:
            hard = rng.normal(30.0, 6.0, images)
            rows = {each: hard + rng.normal(0.0, 1.0, images) for each in names}
            rows["routed"] = hard + rng.normal(lucky, 1.0, images)
            counts = {each: [round(1000 * float(x)) for x in row] for each, row in rows.items()}
            return measured(counts, pixels=[100_000] * images, name=name)

        found = verdict(recipes, [drawn("guide", -5.0)], [drawn("test", 0.0)])
        assert found.preferred == "routed"
        overruled += found.support is Support.OVERRULED
    assert overruled <= 0.05 * 200 + 6  # two standard deviations of that count


def test_simplicity_is_a_ladder() -> None:
    ladder = [
        *(RECIPES[name] for name in ("base", "a", "Stage 1", "uniform", "Stage 1+2")),
    ]
    assert [simplicity(recipe) for recipe in ladder] == [(0, 0), (1, 1), (2, 2), (2, 3), (3, 2)]
    assert simplicity(Recipe.weighted({"a": 0.5, "b": 0.0}, BLOCKS)) == (3, 1)  # half a dose of a
    assert simplicity(Recipe.weighted({"a": 1.0, "b": 0.0}, BLOCKS)) == (1, 1)
    trimmed = Recipe(("a", "b"), BLOCKS, ((0.5, 0.5),) * 2, (1.0, 1.0), (Trim(0.2),))
    assert simplicity(trimmed) == (3, 2)


def test_a_network_that_failed_is_never_recommended_and_compares_with_nothing() -> None:
    guide = measured({"Stage 1": [30, 31, 32, 30, 30], "Stage 1+2": []}, validation=True)
    recipes = {name: RECIPES[name] for name in ("Stage 1", "Stage 1+2")}
    found = verdict(recipes, [guide])
    assert (found.recommended, found.candidates, found.compared) == ("Stage 1", 1, ())
    assert estimate_between([guide], "Stage 1", "Stage 1+2") is None
    with pytest.raises(InputError, match="no network with a finite validation score"):
        verdict({"Stage 1+2": ROUTED}, [guide])
    with pytest.raises(InputError, match="found no validation benchmark"):
        verdict(recipes, [])
    with pytest.raises(InputError, match="simpler network"):
        found.against("uniform")
