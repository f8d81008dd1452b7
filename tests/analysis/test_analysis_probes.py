"""Block probes and selection statistics: recipes and numbers by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import benchmark, flat_spec
from safetensors.torch import save_file

from sfkit.analysis import block_probes, probe_recipes, selection_statistics
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.merging import Recipe, open_pool


def test_a_probe_changes_one_block_of_the_mean() -> None:
    recipes = probe_recipes(["a", "b"], ["x", "y"])
    assert list(recipes) == [("x", "a"), ("x", "b"), ("y", "a"), ("y", "b")]
    assert recipes["y", "b"].weights == ((0.5, 0.5), (0.0, 1.0))
    assert recipes["y", "b"].scales == (1.0, 1.0)
    with pytest.raises(InputError, match="at least two sources"):
        probe_recipes(["a"], ["x"])


def test_every_block_prefers_the_source_that_helps_it(tmp_path: Path) -> None:
    # Disparity = level + offset. The base is (3, 0); a is (7, 0) and b is (3, 2), so that their mean is
    # (5, 1) = 6 px. The truth is 8 px everywhere, so that EPE is |disparity - 8|.
    spec = flat_spec(tmp_path, {"a": 7.0, "b": 3.0}, base=3.0)
    save_file({"level": torch.tensor([3.0]), "offset": torch.tensor([2.0])}, tmp_path / "b.safetensors")
    evaluator = Evaluator(open_pool(spec), benchmark(truths=(8.0,) * 6, metric="epe"))
    found = block_probes(evaluator, ["a", "b"], validation=False)
    assert found.mean == pytest.approx(2.0)
    # level from a: 7 + 1 = 8; from b: 3 + 1 = 4. offset from a: 5 + 0 = 5; from b: 5 + 2 = 7.
    np.testing.assert_allclose(found.values, [[-2.0, 2.0], [1.0, -1.0]])
    assert found.preferred == {"level": "a", "offset": "b"}
    assert not found.noise.any()
    assert found.table().loc["offset", "b"] == pytest.approx(-1.0)
    single = Evaluator(evaluator.pool, benchmark(truths=(8.0,), metric="epe"))
    one_image = block_probes(single, ["a", "b"])
    assert one_image.noise.all()
    assert one_image.preferred == {"level": None, "offset": None}


def runs() -> dict[str, Recipe]:
    blocks = ("x", "y")
    return {
        "one": Recipe(("a", "b"), blocks, ((0.25, 0.75), (0.75, 0.25)), (1.0, 1.5)),
        "two": Recipe(("c", "a"), blocks, ((0.1, 0.9), (0.3, 0.7)), (1.0, 1.0)),
        "three": Recipe.equal(["a", "b"], blocks),
    }


def test_sources_are_counted_with_their_mean_weights() -> None:
    found = selection_statistics(runs(), ["a", "b", "c", "d"], groups={"one": "g", "two": "h", "three": "g"})
    np.testing.assert_allclose(found.weights, [[0.5, 0.5, 0, 0], [0.8, 0, 0.2, 0], [0.5, 0.5, 0, 0]])
    np.testing.assert_allclose(found.frequency, [1.0, 2 / 3, 1 / 3, 0.0])
    np.testing.assert_allclose(found.weight_when_chosen, [0.6, 0.5, 0.2, math.nan])
    # Jaccard: {a, b} and {a, c} share one of three; {a, b} twice is 1.
    assert found.overlap == pytest.approx((1 / 3 + 1 + 1 / 3) / 3)
    table = found.table()
    assert table["chosen under g [%]"].tolist() == [100.0, 100.0, 0.0, 0.0]
    assert table["chosen under h [%]"].tolist() == [100.0, 0.0, 100.0, 0.0]
    assert table["mean weight"].sum() == pytest.approx(1.0)


def test_runs_that_cannot_be_counted_are_refused() -> None:
    with pytest.raises(InputError, match="found no run"):
        selection_statistics({}, ["a"])
    with pytest.raises(InputError, match="run 'one' chose"):
        selection_statistics(runs(), ["a"])
    with pytest.raises(InputError, match="found no group for the runs"):
        selection_statistics(runs(), ["a", "b", "c"], groups={"one": "g"})
    assert math.isnan(selection_statistics({"one": runs()["one"]}, ["a", "b"]).overlap)
