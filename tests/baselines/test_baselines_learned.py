"""Fisher merging and AdaMerging on tiny AnyNets: gradients against finite differences, and their algebra."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from flat_world import benchmark, flat_pool
from tiny import write_pairs, write_pool

from sfkit import baselines
from sfkit.checkpoints.checks import Kind
from sfkit.datasets import open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.gradients import GradientModel, disparity_loss, fisher_information, matching_entropy
from sfkit.merging import Pool, Recipe, open_pool

STEP = 1e-4


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return open_pool(write_pool(tmp_path_factory.mktemp("pool")))


@pytest.fixture(scope="module")
def evaluator(pool: Pool, tmp_path_factory: pytest.TempPathFactory) -> Evaluator:
    pairs = open_benchmark("pairs", write_pairs(tmp_path_factory.mktemp("pairs")))
    return Evaluator(pool, pairs, store=EvaluationStore(":memory:"))


def test_the_gradient_is_the_slope_of_the_loss(pool: Pool, evaluator: Evaluator) -> None:
    """Along a task vector, where AdaMerging walks, and on the loss that Fisher information squares."""
    parts = [slice(s.start, s.stop) for s in pool.layout.segments if s.kind is Kind.WEIGHT]
    for loss in (matching_entropy(pool), disparity_loss):
        model = GradientModel(pool, evaluator.prepared, loss)
        model.take(Recipe.weighted({"a": 0.3, "b": 0.3}, pool.blocks))
        here, gradient = model.flat.clone(), model.gradient(1)[1]
        sides = []
        for step in (STEP, -STEP):
            with torch.no_grad():
                model.flat.copy_(here)
                for part in parts:
                    model.flat[part] += step * pool.vectors["a"][part]
            sides.append(model.gradient(1)[0])
        slope = sum(float(gradient[part] @ pool.vectors["a"][part]) for part in parts)
        assert slope == pytest.approx((sides[0] - sides[1]) / (2 * STEP), rel=0.05)
        statistics = [s for s in pool.layout.segments if s.kind is Kind.STATISTIC]
        assert not any(bool(gradient[s.start : s.stop].any()) for s in statistics)


def test_information_is_the_mean_squared_gradient(pool: Pool, evaluator: Evaluator) -> None:
    recipe = pool.equal("a")
    information = fisher_information(pool, recipe, [evaluator.prepared])
    model = GradientModel(pool, evaluator.prepared, disparity_loss)
    model.take(recipe)
    gradients = torch.stack([model.gradient(n)[1].double() for n in range(2)])
    assert torch.allclose(information.double(), gradients.square().mean(dim=0), rtol=1e-4, atol=1e-12)
    assert float(information.max()) > 0


def test_fisher_with_a_floor_above_all_information_is_uniform(pool: Pool, evaluator: Evaluator) -> None:
    found = baselines.fisher(pool, evaluator, floor=1e9)
    assert found.score == pytest.approx(baselines.uniform(pool, evaluator).score, abs=1e-4)
    real = baselines.fisher(pool, evaluator)
    assert not torch.allclose(real.pool.vectors["fisher"], found.pool.vectors["fisher"], atol=1e-4)
    assert real.image_passes == 3 * 2 + 2, "each source's gradients on two pairs, and one evaluation"
    assert "with labels" in real.note


def test_adamerging_lowers_the_entropy_it_descends(pool: Pool, evaluator: Evaluator) -> None:
    found = baselines.adamerging_blocks(pool, evaluator, steps=6, rate=0.05)
    entropy = list(found.history["entropy"].dropna())  # of the two pairs in turn
    assert entropy[4] + entropy[5] < entropy[0] + entropy[1]
    rows = torch.tensor(found.recipe.weights)
    assert bool(((rows >= 0) & (rows <= 1)).all())
    assert not found.recipe.tied
    assert (found.evaluations, found.image_passes) == (1, 6 + 2)


def test_adamerging_per_source_ties_all_blocks_and_starts_where_it_is_told(
    pool: Pool, evaluator: Evaluator
) -> None:
    still = baselines.adamerging(pool, evaluator, steps=0)
    assert torch.allclose(torch.tensor(still.recipe.weights), torch.full((4, 3), 0.3))
    moved = baselines.adamerging(pool, evaluator, steps=1)
    assert moved.recipe.tied
    # Adam's first step is the rate in every coordinate, whatever the gradient's size.
    steps = torch.tensor(moved.recipe.weights[0]) - 0.3
    assert torch.allclose(steps.abs(), torch.full((3,), 1e-3), atol=1e-5)
    with pytest.raises(InputError, match="adamerging: found steps -1"):
        baselines.adamerging(pool, evaluator, steps=-1)


def test_networks_without_gradients_or_matching_are_refused_with_a_sentence(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path, {"a": 6.0, "b": 9.0})
    evaluator = Evaluator(pool, benchmark("eights", (8.0, 8.0)))
    with pytest.raises(InputError, match="'flat': offers no matching distribution over disparities"):
        baselines.adamerging(pool, evaluator)
    with pytest.raises(InputError, match="the network's output has no gradient"):
        baselines.fisher(pool, evaluator)
    run = baselines.run_baselines(pool, evaluator, population=2, generations=1, evaluations=3)
    assert {"fisher", "adamerging", "adamerging_blocks"} <= set(run.skipped)
