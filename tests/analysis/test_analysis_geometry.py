"""Task-vector geometry: against the files themselves, tensor by tensor, and values by hand."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from flat_world import flat_pool
from safetensors.numpy import load_file
from tiny import write_pool

from sfkit.analysis import geometry as module
from sfkit.analysis import task_vector_geometry
from sfkit.merging import open_pool


def test_two_sources_on_one_parameter(tmp_path: Path) -> None:
    # The base has 5; the sources 4, 12 and 12.5: task vectors of -1, 7 and 7.5.
    found = task_vector_geometry(flat_pool(tmp_path, {"low": 4.0, "high": 12.0, "higher": 12.5}))
    assert found.blocks[0] == "level"
    np.testing.assert_allclose(found.norms[0], [1.0, 7.0, 7.5])
    np.testing.assert_allclose(found.relative[0], [20.0, 140.0, 150.0])
    np.testing.assert_allclose(found.cosines, [[1, -1, -1], [-1, 1, 1], [-1, 1, 1]])
    assert found.conflicts[0] == found.conflict == 1.0
    np.testing.assert_allclose(found.pair_conflicts, [[0, 1, 1], [1, 0, 0], [1, 0, 0]])


def test_numbers_are_those_of_the_files_tensor_by_tensor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CHUNK", 1000)  # several chunks a block, none of them whole
    pool = open_pool(write_pool(tmp_path, sources=3))
    found = task_vector_geometry(pool)
    files = {name: load_file(tmp_path / f"{name}.safetensors") for name in ("base", "a", "b", "c")}
    weights = [
        key
        for key in files["base"]
        if not key.endswith(("running_mean", "running_var", "num_batches_tracked"))
    ]
    patterns = dict(zip(pool.partition.names, pool.partition.patterns, strict=True))
    for number, block in enumerate(found.blocks):
        keys = [key for key in weights if any(fnmatch(key, p) for p in patterns.get(block, ()))]
        if block == "(outside)":
            keys = [key for key in weights if pool.partition.block_of(key) < 0]
        base = np.concatenate([files["base"][key].ravel() for key in keys]).astype(np.float64)
        vectors = np.stack(
            [np.concatenate([files[n][k].ravel() for k in keys]).astype(np.float64) - base for n in "abc"]
        )
        assert found.sizes[number] == base.size
        np.testing.assert_allclose(found.norms[number], np.linalg.norm(vectors, axis=1), rtol=1e-5)
        np.testing.assert_allclose(found.base_norms[number], np.linalg.norm(base), rtol=1e-6)
        signs = np.sign(vectors)
        shared = (signs != 0).sum(axis=0) >= 2
        differ = (signs == 1).any(axis=0) & (signs == -1).any(axis=0)
        assert found.shared[number] == pytest.approx(shared.sum(), abs=1)
        assert found.conflicts[number] == pytest.approx(differ.sum() / shared.sum(), abs=1e-6)
        expected = np.corrcoef(vectors) * 0 + vectors @ vectors.T
        np.testing.assert_allclose(found.products[number], expected, rtol=1e-4, atol=1e-6)
    assert found.table().loc[found.blocks[0], "sign conflicts [%]"] == pytest.approx(100 * found.conflicts[0])


def test_half_of_three_random_directions_conflict_three_quarters_of_the_time(tmp_path: Path) -> None:
    # Signs of three independent symmetric task vectors all agree with probability 1/4.
    found = task_vector_geometry(open_pool(write_pool(tmp_path, sources=3)))
    assert found.conflicts.mean() == pytest.approx(0.75, abs=0.05)
    upper = found.pair_conflicts[np.triu_indices(3, 1)]
    np.testing.assert_allclose(upper, 0.5, atol=0.05)
