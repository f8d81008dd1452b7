from __future__ import annotations

import statistics
from pathlib import Path

import numpy as np
import pytest
from flat_world import benchmark, flat_pool

from sfkit.datasets import Benchmark, MemoryPair, Sample, memory_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import CombinedScorer, EvaluationStore, Evaluator
from sfkit.evaluation.combining import validation_scorer
from sfkit.search import RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings

NAMES = ("low", "high")


def textured(count: int = 3) -> Benchmark:
    """Noise seen from two places, 5 to 7 px apart; no ground truth plays a part."""
    pairs = []
    for n in range(count):
        image = np.random.default_rng(n).integers(0, 256, (24, 70, 3), dtype=np.uint8)
        image = np.repeat(np.repeat(image[:12, :35], 2, axis=0), 2, axis=1)
        left, right = image[:, :60], image[:, 5 + n : 65 + n]
        pairs.append(
            MemoryPair(f"noise{n}", Sample(f"noise{n}", left, right, np.full((24, 60), 5 + n, np.float32)))
        )
    return memory_benchmark("noise", pairs, metric="census")


def test_unlike_metrics_are_combined_by_changes_against_uniform(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    scorer = validation_scorer(pool, (benchmark().measured_by(metric="epe"), textured()))
    assert isinstance(scorer, CombinedScorer)
    recipes = [pool.uniform(), *(pool.equal(name) for name in NAMES)]
    outcomes = scorer(recipes)
    assert outcomes[0].score == 0.0, "uniform is what changes are measured against"
    for recipe, outcome in zip(recipes, outcomes, strict=True):
        by_hand = []
        for part in scorer.evaluators:
            assert isinstance(part, Evaluator)
            mine, uniform = part.evaluate([recipe, pool.uniform()])
            values = [[image.value(part.metric) for image in one.images] for one in (mine, uniform)]
            by_hand.append(
                (statistics.fmean(values[0]) - statistics.fmean(values[1])) / statistics.stdev(values[1])
            )
        assert outcome.score == pytest.approx(statistics.fmean(by_hand))


def test_one_kind_of_metric_is_combined_as_it_is(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    scorer = validation_scorer(pool, (textured(), textured(2)))
    assert isinstance(scorer, CombinedScorer)
    assert scorer.changes is None


def test_one_pair_has_no_spread(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'noise': has one pair, expected two or more to combine census"):
        validation_scorer(flat_pool(tmp_path), (benchmark().measured_by(metric="epe"), textured(1)))


def test_searches_guided_without_labels_repeat_nothing(tmp_path: Path) -> None:
    pool, path = flat_pool(tmp_path), tmp_path / "store.sqlite"
    settings = RoutingSettings(evaluations=12, seed=1)

    def both() -> tuple[str, int]:
        with EvaluationStore(path) as store:
            scorer = validation_scorer(pool, (benchmark().measured_by(metric="epe"), textured()), store=store)
            assert isinstance(scorer, CombinedScorer)
            subset = SubsetSearch(pool.names, pool.blocks, scorer, SubsetSettings(4, 2, seed=1)).run().subset
            found = RoutingSearch(subset, pool.blocks, scorer, settings).run()
            computed = sum(part.counts.computed for part in scorer.evaluators if isinstance(part, Evaluator))
            return f"{found.recipe} {found.score!r}", computed

    first, computed = both()
    assert computed > 0
    assert both() == (first, 0)
