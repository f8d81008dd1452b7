"""What is said of ways to run Stage 2 is what their tables say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from benchmark_scripts import imported

from sfkit.datasets import Sample
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search.surrogate import routing_features


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("stage2", "stage2_worlds", "one_model") as modules:
        yield modules


def test_the_section_counts_against_cma_es_of_the_same_search(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage2 = scripts[0]
    monkeypatch.setattr(stage2, "kept", replace(stage2.kept, folder=tmp_path))
    with pytest.raises(SystemExit, match="nothing is finished yet"):
        stage2.section()

    def finished(seed: int, way: str, scores: list[float]) -> None:
        head = {"world": "bank", "seed": seed, "way": way, "evaluation": range(1, len(scores) + 1)}
        tail = {"seconds": 1.0, "subset": "a+b", "stage1": 3, "dimension": 6}
        name = f"bank-{stage2.slug(way)}-{seed:02d}.csv"
        pd.DataFrame({**head, "score": scores, **tail}).to_csv(tmp_path / name, index=False)

    for seed, aim in ((0, 5.0), (1, 7.0)):
        finished(seed, stage2.CMA_ES, [9.0] * 299 + [aim])
    finished(0, stage2.MODEL, [9.0, 6.0, 5.0, 4.0] + [8.0] * 6)
    finished(1, stage2.MODEL, [9.0, 8.0] + [7.5] * 8)
    finished(2, stage2.MODEL, [1.0] * 10)  # no CMA-ES of that search yet
    finished(0, stage2.ONE_MODEL, [1.0, 6.0, 6.0, 5.5] + [6.0] * 9)  # the first three are Stage 1's
    written = stage2.section()
    assert "| CMA-ES | 6 | +3.00 (+2.50 to +3.50)" in written
    assert "+0.00 (+0.00 to +0.00) | 300 | 2 of 2 |" in written
    assert "| model | 6 | -0.25 (-0.62 to +0.12) |  |" in written
    assert "| more | 1 of 2 |" in written
    assert "| one model, no stages | 6 | -4.00 (-4.00 to -4.00) |" in written


def test_windows_are_the_same_in_both_views(scripts: tuple[ModuleType, ...]) -> None:
    ramp = np.arange(20 * 30 * 3, dtype=np.int64).reshape(20, 30, 3)
    left = (ramp % 256).astype(np.uint8)
    disparity = np.arange(600, dtype=np.float32).reshape(20, 30)
    cut = scripts[1].window(Sample("pair", left, left[:, ::-1].copy(), disparity), (8, 10))
    assert cut.size == (8, 10)
    assert np.array_equal(cut.left, left[6:14, 10:20])
    assert np.array_equal(cut.right, left[:, ::-1][6:14, 10:20])
    assert cut.disparity[0, 0] == 6 * 30 + 10


def test_vectors_have_the_features_of_the_recipes_they_stand_for(scripts: tuple[ModuleType, ...]) -> None:
    names, blocks = ("a", "b", "c", "d"), ("backbone", "head")
    around = scripts[2].Around(Recipe.equal(("d", "b"), blocks), names, lambda _: [])
    draws = np.random.default_rng(0).standard_normal((5, around.encoding.dimension))
    mine = around._points(draws)
    theirs = routing_features([around.encoding.decode(x) for x in draws], names, blocks, tied=True)
    for one, other in zip(mine, theirs, strict=True):
        assert one == pytest.approx(other, abs=1e-12)


def test_one_model_goes_from_subsets_to_weights_and_scales(
    scripts: tuple[ModuleType, ...],
) -> None:
    """On a score whose best is a mixture of two sources, one scaled up, that no equal merge comes near."""
    names, blocks = ("a", "b", "c", "d"), ("backbone", "head")
    seen: list[Recipe] = []

    def scorer(recipes: Sequence[Recipe]) -> list[Outcome]:
        seen.extend(recipes)
        found = []
        for recipe in recipes:
            rows, scales = (np.array(part) for part in recipe.over(names, blocks))
            aim = np.array([0.8, 0.0, 0.2, 0.0])
            found.append(Outcome(10.0 * float(np.abs(rows - aim).sum() + np.abs(scales - 1.2).sum())))
        return found

    pool = SimpleNamespace(
        names=names, blocks=blocks, equal=lambda *sources: Recipe.equal(tuple(sources), blocks)
    )
    world = SimpleNamespace(pool=pool, seed=0, scorer=scorer)
    scores = list(scripts[2].one_model(world, 30))
    assert len(scores) == len(seen) == len(set(seen)) == 30
    assert scores[:4] == [np.inf] * 4  # alone they win nothing
    equal = [recipe == pool.equal(*recipe.sources) for recipe in seen]
    assert all(equal[:12])
    best = min(score for score, one in zip(scores, equal, strict=True) if one)
    assert min(scores) < 0.7 * best
