"""The averaged winner: against resamples scored one by one, by hand, and after searches broken off."""

from __future__ import annotations

import json
import math
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import flat_world
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sfkit.datasets.benchmark import memory_benchmark
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation import CombinedScorer, EvaluationStore, Evaluator
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.merging import Pool, Recipe
from sfkit.merging.origin import read_recipe
from sfkit.search import Constraints, RoutingSettings, SubsetSettings, pipeline
from sfkit.search.averaging import AVERAGED, Averaged, average, averaged_winner, resampled, winners
from sfkit.search.journal import JournalledSearch, read_journal
from sfkit.search.pipeline import SearchResult, search_pool
from sfkit.search.plan import SearchPlan
from sfkit.streams import Stream, generator

LEVELS = {"a": 4.0, "b": 12.0, "c": 2.0, "d": 6.5}
TRUTHS = (5.0, 8.0, 3.5, 6.25, 9.0)
BLOCKS = ("level", "offset")
PLAN = SearchPlan(
    stage1=SubsetSettings(population=6, generations=2, seed=3),
    stage2=RoutingSettings(evaluations=14, seed=3),
    resamples=60,
)


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_world.flat_pool(tmp_path_factory.mktemp("averaging"), LEVELS)


def evaluator(pool: Pool, truths: Sequence[float] = TRUTHS, name: str = "noise") -> Evaluator:
    return Evaluator(pool, flat_world.benchmark(name, tuple(truths), metric="epe"))


def blends(pool: Pool) -> list[Recipe]:
    return [*(pool.equal(name) for name in pool.names), pool.uniform(), pool.equal("a", "b")]


def test_a_resample_scores_as_a_benchmark_of_its_pairs(pool: Pool) -> None:
    recipes, scorer = blends(pool), evaluator(pool)
    scorer(recipes)
    drawn = generator(5, Stream.BOOTSTRAP_AVERAGE).integers(len(TRUTHS), size=(2, len(TRUTHS)))
    for row, images in zip(resampled(scorer, recipes, 2, 5), drawn, strict=True):
        samples = [flat_world.sample(f"pair{n}", TRUTHS[i]) for n, i in enumerate(images)]
        literal = Evaluator(pool, memory_benchmark("drawn", samples, metric="epe"))
        assert row == pytest.approx([outcome.score for outcome in literal(recipes)], abs=1e-6)
    assert (scorer.counts.computed, scorer.counts.cached) == (len(recipes), 0), "nothing more was asked"


def test_pooled_scores_are_pooled_over_the_resample(pool: Pool) -> None:
    images = [flat_world.sample(f"pair{n}", truth, n) for n, truth in enumerate((5.0, 7.0, 9.0))]
    images[1].disparity[:20] = np.nan  # half as many pixels as the others
    pairs = memory_benchmark("drive", images, metric="bad-3.0", protocol="raft", family="kitti")
    scorer, recipes = Evaluator(pool, pairs), blends(pool)
    (errors,) = [one.images for one in scorer.evaluate(recipes[1:2])]
    drawn = generator(1, Stream.BOOTSTRAP_AVERAGE).integers(3, size=(6, 3))
    expected = [scorer.score([errors[i] for i in images]) for images in drawn]
    assert resampled(scorer, recipes, 6, 1)[:, 1] == pytest.approx(expected)
    assert len(set(expected)) > 2


@pytest.mark.parametrize("how", ["mean", "worst"])
def test_of_several_benchmarks_benchmarks_are_drawn_too(pool: Pool, how: str) -> None:
    """Of one pair each, as the recorded runs on real pairs are: a resample is of the pairs all alike."""
    truths, recipes = (5.0, 8.0, 3.5), blends(pool)
    scorer = CombinedScorer([evaluator(pool, [t], f"n{t}") for t in truths], how)
    drawn = generator(2, Stream.BOOTSTRAP_AVERAGE).integers(3, size=(9, 3))
    for row, chosen in zip(resampled(scorer, recipes, 9, 2), drawn, strict=True):
        table = np.array([[o.score for o in scorer.evaluators[b](recipes)] for b in chosen])
        assert row == pytest.approx(table.mean(axis=0) if how == "mean" else table.max(axis=0))


def test_several_pairs_of_several_benchmarks_are_drawn_within_them(pool: Pool) -> None:
    recipes = blends(pool)
    scorer = CombinedScorer([evaluator(pool), evaluator(pool, (7.5, 9.0), "far")])
    found = resampled(scorer, recipes, 400, 0)
    whole = np.array([outcome.score for outcome in scorer(recipes)])
    error = found.std(axis=0) / math.sqrt(len(found))
    assert np.all(np.abs(found.mean(axis=0) - whole) < 5 * error), "unbiased"
    assert np.array_equal(found, resampled(scorer, recipes, 400, 0))


def test_the_earlier_of_equals_wins() -> None:
    assert winners(np.array([[2.0, 1.0, 1.0], [0.5, 0.5, 3.0]])) == [1, 0]


def test_an_average_by_hand() -> None:
    one = Recipe(("a", "b"), BLOCKS, ((0.5, 0.5), (0.5, 0.5)), (1.0, 1.5))
    two = Recipe(("b", "c"), BLOCKS, ((0.25, 0.75), (0.25, 0.75)), (1.0, 0.5))
    found = average({one: 3, two: 1}, ("c", "b", "a"))
    assert found.sources == ("c", "b", "a"), "in the pool's order"
    # level: both scales are 1; offset: 3/4 * 1.5 * (a 0.5, b 0.5) + 1/4 * 0.5 * (b 0.25, c 0.75)
    assert found.weights[0] == (0.1875, 0.4375, 0.375)
    assert found.scales == (1.0, 1.25)
    assert found.weights[1] == pytest.approx((0.09375 / 1.25, 0.59375 / 1.25, 0.5625 / 1.25))
    assert average({one: 7}, ("a", "b")) is one, "no new recipe where one candidate wins every resample"
    with pytest.raises(InputError, match="over other blocks"):
        average({one: 1, Recipe.equal(("a",), ("level",)): 1}, ("a", "b"))


shares = st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3).map(
    lambda row: tuple(x / math.fsum(row) for x in row)
)
routings = st.builds(
    lambda rows, scales: Recipe(("a", "b", "c"), BLOCKS, tuple(rows), tuple(scales)),
    st.lists(shares, min_size=2, max_size=2),
    st.lists(st.floats(0.0, 2.0), min_size=2, max_size=2),
)


@settings(max_examples=25)
@given(st.dictionaries(routings, st.integers(1, 9), min_size=1, max_size=4))
def test_strengths_are_averaged_and_rows_stay_on_the_simplex(counts: Mapping[Recipe, int]) -> None:
    found, total = average(counts, ("a", "b", "c")), sum(counts.values())
    for b in range(2):
        assert math.fsum(found.weights[b]) == pytest.approx(1.0)
        for e in range(3):
            wanted = math.fsum(n * r.scales[b] * r.weights[b][e] / total for r, n in counts.items())
            assert found.scales[b] * found.weights[b][e] == pytest.approx(wanted, abs=1e-12)


def run(folder: Path, pool: Pool, plan: SearchPlan = PLAN) -> tuple[SearchResult, Evaluator]:
    with EvaluationStore(folder / "evaluations.sqlite") as store:
        scorer = evaluator(pool).with_store(store)
        return search_pool(pool, scorer, plan, folder / "out"), scorer


@pytest.fixture(scope="module")
def whole(pool: Pool, tmp_path_factory: pytest.TempPathFactory) -> SearchResult:
    """A search that nothing happened to."""
    return run(tmp_path_factory.mktemp("whole"), pool)[0]


def test_a_search_returns_and_writes_the_average_of_its_winners(
    pool: Pool, whole: SearchResult, tmp_path: Path
) -> None:
    found = whole
    plain, before = run(tmp_path, pool, replace(PLAN, resamples=0))
    assert found.averaged is not None
    assert plain.averaged is None
    assert len(_keys(found.folder.parent)) == before.counts.computed + 1, "one evaluation more"
    assert sum(win.wins for win in found.averaged.wins) == PLAN.resamples
    assert len(found.averaged.wins) > 1
    counts = {win.candidate.recipe: win.wins for win in found.averaged.wins}
    assert found.recipe == average(counts, pool.names)
    assert found.score == evaluator(pool)([found.recipe])[0].score
    assert (found.best, found.stages[AVERAGED]) == (plain.recipe, found.recipe)
    assert found.evaluations[AVERAGED] == found.evaluations["Stage 1+2"] + 1
    out = found.folder
    assert read_recipe(out / "recipe.json") == read_recipe(out / "merged.safetensors") == found.recipe
    assert read_recipe(out / "best.json") == plain.recipe
    assert json.loads((out / "result.json").read_text())["averaged"] == found.score
    records = read_journal(out / "journal.jsonl")
    (record,) = [one for one in records if one["event"] == "average"]
    assert Recipe.from_dict(record["recipe"]) == found.recipe
    routing = JournalledSearch.find(records, "routing")
    assert routing is not None
    assert routing.reason is not None, "the stages are read as ever"
    for name in ("best.json", "winners.csv"):
        assert not (plain.folder / name).exists()
    for name in ("stage1.csv", "stage2.csv"):
        numbers = [pd.read_csv(place / name)["score"] for place in (plain.folder, out)]
        assert numbers[0].equals(numbers[1])


class BreaksError(Exception):
    """What ends a search from outside."""


@pytest.mark.parametrize("asked", [8, 26])
def test_broken_off_anywhere_it_ends_as_if_it_had_not_been(
    pool: Pool, whole: SearchResult, tmp_path: Path, asked: int
) -> None:
    folder = tmp_path / "broken"
    with EvaluationStore(folder / "evaluations.sqlite") as store:
        scorer = evaluator(pool).with_store(store)
        calls = Counter[str]()

        def broken(*_: int) -> None:
            calls["asked"] += 1
            if calls["asked"] == asked:
                raise BreaksError

        scorer.listen = broken
        with pytest.raises(BreaksError):
            search_pool(pool, scorer, PLAN, folder / "out")
        held = len(store)
    again, counted = run(folder, pool)
    assert counted.counts.computed + held == len(_keys(whole.folder.parent))
    for name in ("result.json", "winners.csv", "recipe.json", "best.json"):
        assert (folder / "out" / name).read_bytes() == (whole.folder / name).read_bytes()
    assert again.recipe == whole.recipe


def _keys(folder: Path) -> list[str]:
    with EvaluationStore(folder / "evaluations.sqlite") as store:
        return [evaluation.key for evaluation in store]


def test_finished_it_is_read_back_at_no_pass(pool: Pool, whole: SearchResult, tmp_path: Path) -> None:
    shutil.copy(whole.folder.parent / "evaluations.sqlite", tmp_path)
    second, scorer = run(tmp_path, pool)
    assert (scorer.counts.computed, second.recipe) == (0, whole.recipe)


def test_without_it_a_plan_says_what_it_ever_said(pool: Pool) -> None:
    plain = replace(PLAN, resamples=0)
    assert "resamples" not in plain.describe()
    assert {**plain.describe(), "resamples": 60} == PLAN.describe()
    assert PLAN.by("bayesian").resamples == 60
    assert json.dumps(replace(PLAN, resamples=np.int64(60)).describe()) == json.dumps(PLAN.describe())
    assert PLAN.evaluations(pool.names, pool.blocks) == plain.evaluations(pool.names, pool.blocks) + 1


def deaf(recipes: Sequence[Recipe]) -> list[Outcome]:
    raise AssertionError("nothing is scored before the refusal")


REFUSED: dict[str, tuple[SearchPlan, str]] = {
    "largest": (
        replace(PLAN, constraints=Constraints(largest=2)),
        r"largest: found 2 and resamples 60, whose winners together may have up to 4 sources",
    ),
    "frozen": (
        replace(
            PLAN,
            stage2=RoutingSettings(tied=False),
            constraints=Constraints(frozen_blocks=("level",)),
        ),
        "frozen_blocks: found level with block-specific routing and resamples 60",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_limits_an_average_may_break_are_refused(pool: Pool, tmp_path: Path, case: str) -> None:
    plan, sentence = REFUSED[case]
    with pytest.raises(InputError, match=sentence):
        search_pool(pool, evaluator(pool), plan, tmp_path / "out")
    replace(plan, subset=("a", "b")).check(pool)  # winners of one subset meet them together
    assert not (tmp_path / "out").exists()


def test_a_frozen_block_stays_frozen(pool: Pool, tmp_path: Path) -> None:
    limits = Constraints(frozen_blocks=("offset",), include=("d",), exclude=("c",))
    found, _ = run(tmp_path, pool, replace(PLAN, constraints=limits))
    assert found.averaged is not None
    assert len(found.averaged.wins) > 1
    assert found.recipe.of("offset")[1] == 1.0
    assert "d" in found.recipe.sources
    assert "c" not in found.recipe.sources


PLAIN = replace(PLAN, resamples=0)
AVERAGES: dict[str, tuple[SearchPlan, int, int]] = {
    "both stages": (PLAIN, 5, 200),
    "one pair": (PLAIN, 1, 0),
    "Stage 1 alone": (replace(PLAIN, stage2=None), 5, 0),
    "Stage 2 alone": (replace(PLAIN, subset=("a", "b")), 5, 0),
    "a penalty": (replace(PLAIN, stage2=RoutingSettings(shrinkage=0.25)), 5, 0),
    "a hold-out": (replace(PLAIN, stage2=RoutingSettings(holdout=0.5)), 5, 0),
    **{case: (replace(plan, resamples=0), 5, 0) for case, (plan, _) in REFUSED.items()},
}
"""Plan, validation pairs, and over how many resamples it averages where that is left to it."""


@pytest.mark.parametrize("case", AVERAGES)
def test_winners_are_averaged_where_both_stages_run_and_nothing_speaks_against_it(
    pool: Pool, case: str
) -> None:
    plan, pairs, resamples = AVERAGES[case]
    found = plan.averaging(pool, evaluator(pool, TRUTHS[:pairs]))
    assert found == replace(plan, resamples=resamples)
    wrong = replace(plan, constraints=Constraints(include=("nobody",)))
    with pytest.raises(InputError, match="nobody"):
        wrong.averaging(pool, evaluator(pool))


@pytest.mark.parametrize("name", ["holdout", "entropy", "shrinkage"])
def test_a_stage_2_that_chooses_otherwise_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=rf"resamples: found {name} 0.25, by which Stage 2"):
        SearchPlan(stage2=replace(RoutingSettings(), **{name: 0.25}), resamples=9)
    with pytest.raises(InputError, match="resamples: found -1, expected a whole number of at least 0"):
        SearchPlan(resamples=-1)


@pytest.mark.parametrize(
    ("scorer", "sentence"),
    [
        (deaf, "found a scorer of the kind function, expected an Evaluator"),
        (None, "resamples: found one validation pair, expected at least 2"),
    ],
)
def test_what_has_no_pairs_to_draw_is_refused(
    pool: Pool, tmp_path: Path, scorer: Scorer | None, sentence: str
) -> None:
    guide = scorer or evaluator(pool, [5.0])
    with pytest.raises(InputError, match=sentence):
        search_pool(pool, guide, PLAN, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_average_that_fails_is_told_and_not_taken(pool: Pool, tmp_path: Path) -> None:
    class Fails(Evaluator):
        """The flat networks cannot fail where their winners do not."""

        last = False

        def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
            if self.last:
                return [Outcome(math.inf, error="NaN")]
            return super().__call__(recipes)

    scorer = Fails(pool, flat_world.benchmark("noise", TRUTHS, metric="epe"))
    search = PLAN.subset_search(pool.names, pool.blocks, scorer)
    search.run()
    scorer.last = True
    found = averaged_winner([search], scorer, 50, seed=1)
    assert found.outcome.failed
    assert found.as_record()["error"] == "NaN"


def test_an_average_without_a_finite_score_gives_way_to_the_best(
    pool: Pool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def infinite(*given: Any, **more: Any) -> Averaged:
        return replace(averaged_winner(*given, **more), outcome=Outcome(math.inf))

    monkeypatch.setattr(pipeline, "averaged_winner", infinite)
    with pytest.warns(SfkitWarning, match=r"no finite score \(found inf\), the best on validation is taken"):
        found, _ = run(tmp_path, pool)
    assert (found.recipe, AVERAGED in found.stages) == (found.best, False)
    assert math.isfinite(found.score)
    text = (found.folder / "result.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail)["averaged"] is None
