"""The evaluator: scores by hand, predictions that are not finite, networks that raise, shared stores."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import LEVELS, benchmark, calls, flat_pool, repaired, sample

from sfkit.datasets.benchmark import Benchmark, memory_benchmark, open_benchmark
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation import (
    CombinedScorer,
    EvaluationStore,
    Evaluator,
    Outcome,
    estimate,
    prepared,
    validation_scorer,
)
from sfkit.merging import Pool, Recipe
from sfkit.search import SubsetSearch, SubsetSettings


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return flat_pool(tmp_path_factory.mktemp("flat"))


@pytest.fixture(autouse=True)
def counted() -> None:
    calls.clear()
    repaired.clear()


def test_scores_by_hand(pool: Pool) -> None:
    """Levels 4, 12 and their mean 8 against truths of 5 and 8 px: errors by subtraction."""
    evaluator = Evaluator(pool, benchmark())
    low, high, both, base = evaluator.evaluate(
        [pool.equal("low"), pool.equal("high"), pool.equal("low", "high"), pool.base_recipe()]
    )
    expected = {
        "epe": [(1 + 4) / 2, (7 + 4) / 2, (3 + 0) / 2, (0 + 3) / 2],
        "bad-1.0": [50.0, 100.0, 50.0, 50.0],
        "bad-3.0": [50.0, 100.0, 0.0, 0.0],
        "d1": [50.0, 100.0, 0.0, 0.0],
    }
    for metric, values in expected.items():
        assert [evaluator.score(e.images, metric) for e in (low, high, both, base)] == values, metric
    assert [image.id for image in low.images] == ["pair0", "pair1"]
    assert low.images[0].pixels == 40 * 30, "unknown truth does not count"
    assert evaluator.outcome(low).score == 50.0, "the benchmark's own metric"


def test_a_prediction_of_nan_scores_100_and_is_flagged(pool: Pool) -> None:
    """One NaN far from every valid pixel is enough: the map is broken, and ``nan > t`` would score 0."""
    evaluator = Evaluator(pool, benchmark(), also=("epe", "d1"))
    (evaluation,) = evaluator.evaluate([pool.equal("below")])
    assert evaluation.failure is None, "it is scored, not failed"
    assert [evaluator.score(evaluation.images, metric) for metric in ("bad-1.0", "d1")] == [100.0, 100.0]
    assert evaluator.score(evaluation.images, "epe") == math.inf
    assert [image.nonfinite for image in evaluation.images] == [1, 1]
    assert all(image.flagged for image in evaluation.images)


def test_a_network_that_raises_is_recorded_and_not_tried_again(pool: Pool, tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        evaluator = Evaluator(pool, benchmark(), store=store)
        recipes = [pool.equal("wild"), pool.equal("low")]
        failed, fine = evaluator(recipes)
        assert failed.failed
        assert failed.score == math.inf
        assert failed.error == "RuntimeError: level 90 is too high"
        assert fine.score == 50.0, "the run goes on"
        again = Evaluator(pool, benchmark(), store=store)
        assert [outcome.error for outcome in again(recipes)] == [failed.error, None]
        assert again.counts.computed == 0
        assert calls == [90, 4, 4]

        repaired.add("error")
        assert Evaluator(pool, benchmark(), store=store)(recipes)[0].failed, "only on request"
        retrying = Evaluator(pool, benchmark(), store=store, retry_failed=True)
        assert retrying(recipes)[0].score == 100.0
        assert (retrying.counts.computed, retrying.counts.cached) == (1, 1)
        assert store.attempts(failed.key) == 2
        assert Evaluator(pool, benchmark(), store=store)(recipes)[0].score == 100.0


def test_a_failing_candidate_loses_and_never_ends_a_search(pool: Pool) -> None:
    evaluator = Evaluator(pool, benchmark(metric="epe"))
    search = SubsetSearch(pool.names, pool.blocks, evaluator, SubsetSettings(population=8, generations=3))
    best = search.run()
    assert search.counts.failed > 0
    assert best.score == min(c.score for c in search.candidates)
    means = {c.subset: sum(LEVELS[n] for n in c.subset) / len(c.subset) for c in search.candidates}
    assert means[best.subset] <= 50
    assert best.score == pytest.approx(sum(abs(means[best.subset] - t) for t in (5, 8)) / 2)


def test_equal_recipes_run_once_and_each_is_stored_before_it_is_told(pool: Pool) -> None:
    evaluator = Evaluator(pool, benchmark())
    heard = []

    def progress(done: int, total: int) -> None:
        heard.append((done, total))
        assert len(evaluator.store) == done

    recipes = [pool.equal("low"), pool.equal("high"), Recipe.weighted({"low": 1.0, "high": 0.0}, pool.blocks)]
    first, _, third = evaluator.evaluate(recipes, progress=progress)
    assert heard == [(0, 2), (1, 2), (2, 2)]
    assert first.images == third.images
    counts = evaluator.counts
    assert (counts.computed, counts.cached, counts.failed, counts.image_passes) == (2, 0, 0, 4)
    assert len(calls) == 4


def test_two_evaluators_share_one_store(pool: Pool, tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as one, EvaluationStore(tmp_path / "s.sqlite") as other:
        first, second = (Evaluator(pool, benchmark(), store=store) for store in (one, other))
        told = first([pool.equal("low")])[0]
        heard = second([pool.equal("low"), pool.equal("high")])
        assert (told.cached, heard[0].cached, heard[1].cached) == (False, True, False)
        assert heard[0].score == told.score
        assert first([pool.equal("high")])[0].cached
        assert first.counts.computed + second.counts.computed == len(one) == 2


def test_another_store_keeps_the_images_and_starts_counting_anew(pool: Pool, tmp_path: Path) -> None:
    evaluator = Evaluator(pool, benchmark())
    evaluator([pool.equal("low")])
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        moved = evaluator.with_store(store)
        moved([pool.equal("low")])
        assert moved.counts.computed == len(store) == 1
    assert moved.prepared is evaluator.prepared
    assert evaluator.counts.computed == 1


def test_thresholds_that_were_asked_for_are_recorded(pool: Pool) -> None:
    evaluator = Evaluator(pool, benchmark(metric="bad-2.5"), also=("bad-0.25",))
    (evaluation,) = evaluator.evaluate([pool.base_recipe()])
    assert evaluation.images[0].thresholds == (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
    assert evaluator.score(evaluation.images) == 50.0, "errors of 0 and 3 px"
    with pytest.raises(InputError, match=r"bad-7\.0 was not recorded"):
        evaluator.score(evaluation.images, "bad-7.0")


def test_inputs_that_are_not_kept_give_the_same_scores(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    recipes = [pool.equal("low"), pool.uniform()]
    kept = Evaluator(pool, benchmark())(recipes)
    monkeypatch.setattr(prepared, "KEEP_BYTES", 0)
    evaluator = Evaluator(pool, benchmark())
    assert [o.score for o in evaluator(recipes)] == [o.score for o in kept]
    assert evaluator.prepared.pair(0) is not evaluator.prepared.pair(0)


def test_a_released_network_is_made_again(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    build = Pool.build
    monkeypatch.setattr(Pool, "build", lambda pool: made.append(pool) or build(pool))
    evaluator = Evaluator(pool, benchmark())
    evaluator([pool.equal("low"), pool.uniform()])
    assert len(made) == 1
    evaluator.release()
    assert evaluator([pool.equal("high"), pool.equal("low")])[0].score == 100.0
    assert len(made) == 2


def without_truth(name: str) -> Benchmark:
    return memory_benchmark(name, [sample("a", 5.0), sample("b", math.inf)])


def test_a_pair_without_a_valid_pixel_is_refused_before_anything_runs(pool: Pool) -> None:
    with pytest.raises(InputError, match="b: protocol 'all-valid' found no valid pixel"):
        Evaluator(pool, without_truth("x"))
    assert calls == []


def test_the_estimate_is_one_stored_evaluation(pool: Pool, tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        evaluator = Evaluator(pool, benchmark(), store=store)
        found = estimate(evaluator, pool.uniform(), 300)
        stored = store.get(evaluator([pool.uniform()])[0].key)
        assert stored is not None
        assert found.seconds_each == stored.seconds
        assert found.minutes == pytest.approx(300 * stored.seconds / 60)
        assert found.images == 2
        assert found.memory_bytes > 1 << 20
        assert str(found).startswith("at most 300 evaluations of 2 pairs, ")
        assert evaluator.counts.computed == len(store) == 1


class Fixed:
    """A scorer with one answer."""

    def __init__(self, score: float, *, cached: bool = True, error: str | None = None) -> None:
        self.answer = Outcome(score, seconds=1.5, cached=cached, error=error, key=f"k{score:g}")

    def __call__(self, recipes: object) -> list[Outcome]:
        return [self.answer]


@pytest.mark.parametrize(("how", "score"), [("mean", 20.0), ("worst", 30.0)])
def test_several_benchmarks_count_by_their_mean_or_their_worst(pool: Pool, how: str, score: float) -> None:
    both = CombinedScorer([Fixed(10.0), Fixed(30.0, cached=False)], how)
    (outcome,) = both([pool.uniform()])
    assert outcome == Outcome(score, seconds=3.0, cached=False, error=None, key="k10+k30")


def test_one_failure_fails_the_combination(pool: Pool) -> None:
    (outcome,) = CombinedScorer([Fixed(10.0), Fixed(math.inf, error="out of memory")])([pool.uniform()])
    assert outcome.failed
    assert outcome.error == "out of memory"


def test_combined_evaluators(pool: Pool) -> None:
    near = Evaluator(pool, benchmark("near", (5.0,), metric="epe"))
    far = Evaluator(pool, benchmark("far", (9.0,), metric="epe"))
    recipes = [pool.equal("low"), pool.equal("low", "high")]
    assert [o.score for o in CombinedScorer([near, far])(recipes)] == [(1 + 5) / 2, (3 + 1) / 2]
    assert [o.score for o in CombinedScorer([near, far], "worst")(recipes)] == [5, 3]
    assert all(o.cached for o in CombinedScorer([near, far])(recipes))


def test_what_cannot_be_combined_is_refused(pool: Pool) -> None:
    pixels = Evaluator(pool, benchmark(metric="epe"))
    percent = Evaluator(pool, benchmark(metric="d1"))
    with pytest.raises(InputError, match=r"metrics in % and px, expected one unit"):
        CombinedScorer([pixels, percent])
    with pytest.raises(InputError, match="found no benchmark"):
        CombinedScorer([])
    with pytest.raises(InputError, match="found 'best', expected 'mean' or 'worst'"):
        CombinedScorer([pixels], "best")


REAL = (
    {"name": "eth3d", "root": "eth3d", "protocol": "raft"},
    {"name": "kitti2012", "root": "kitti2012", "protocol": "all-valid"},
    {"name": "pairs", "root": "pairs", "table": "pairs.csv"},
)
TABLE = """left,right,disparity,coding,id
motorcycle/motorcycle_left.png,motorcycle/motorcycle_right.png,motorcycle/motorcycle_disp.npz,npz,motorcycle
cones/im2.png,cones/im6.png,cones/disp2.png,png8:4,cones
reindeer/view1.png,reindeer/view5.png,reindeer/disp1.png,png8:2,reindeer
"""


@pytest.mark.parametrize("where", REAL, ids=lambda where: where["name"])
def test_real_pairs_raise_no_doubt_until_they_are_exchanged(
    where: dict[str, str], pool: Pool, real_data: Path, tmp_path: Path
) -> None:
    (tmp_path / "pairs.csv").write_text(TABLE)
    place = {**where, "root": real_data / where["root"]}
    if "table" in place:
        place["table"] = tmp_path / "pairs.csv"
    found = open_benchmark(**place)
    Evaluator(pool, found)  # a warning would be an error here
    for one in found.samples():
        exchanged = np.copy(one.left), np.copy(one.right)
        turned = type(one)(one.id, exchanged[1], exchanged[0], one.disparity, one.nonoccluded)
        with pytest.warns(SfkitWarning, match=f"{one.id!r} looks wrong: left and right look exchanged"):
            Evaluator(pool, memory_benchmark("turned", [turned], family=found.family))


def test_a_scale_that_was_guessed_wrong_is_pointed_out(pool: Pool) -> None:
    with pytest.warns(SfkitWarning, match=r"pair 'b' looks wrong: 100.0 % of the disparities exceed"):
        Evaluator(pool, memory_benchmark("x", [sample("a", 5.0), sample("b", 500.0)]))


def test_one_scorer_for_one_benchmark_or_several(pool: Pool) -> None:
    one, other = benchmark("one", metric="epe"), benchmark("other", (6.0,))
    alone = validation_scorer(pool, one)
    assert isinstance(alone, Evaluator)
    assert isinstance(validation_scorer(pool, [one]), Evaluator)
    worst = validation_scorer(pool, [one, other], how="worst")
    # Level 12 against 5 and 8 px, and against 6: the first one's metric measures both.
    assert worst([pool.equal("high")])[0].score == 6.0
    assert validation_scorer(pool, [one, other])([pool.equal("high")])[0].score == (5.5 + 6.0) / 2
    cost = estimate(worst, pool.equal("high"), 100)
    assert (cost.images, cost.evaluations, cost.workers) == (3, 100, 1)
    for empty in ([], ()):
        with pytest.raises(InputError, match="validation: found no benchmark"):
            validation_scorer(pool, empty)
    with pytest.raises(InputError, match="estimate: found a scorer that is no Evaluator"):
        estimate(CombinedScorer([lambda recipes: []]), pool.equal("high"), 1)


def test_a_network_may_write_its_next_map_where_the_last_one_lay(
    pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(pool, benchmark(truths=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)), metric="epe")
    evaluator([pool.uniform()])
    maps: list[torch.Tensor] = []

    def forward(left: torch.Tensor, _right: torch.Tensor) -> torch.Tensor:
        if not maps:
            maps.append(torch.zeros(1, *left.shape[-2:]))
        return maps[0].add_(10.0)

    monkeypatch.setattr(evaluator.engine.worker.model.network, "forward", forward)
    (found,) = evaluator.evaluate([pool.equal("low")])
    assert [image.value("epe") for image in found.images] == [9.0, 18.0, 27.0, 36.0, 45.0, 54.0]
