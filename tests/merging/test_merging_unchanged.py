"""Files that change while a pool or a benchmark is open: refused before a number of theirs is believed."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import SIZE, benchmark, flat_spec, sample
from safetensors.torch import load_file, save_file

import sfkit
from sfkit.architectures import InputConvention
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.datasets.digests import file_digest
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import MemoryPair
from sfkit.errors import InputError
from sfkit.evaluation.metrics import Quantities
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging import members
from sfkit.merging.cache import VectorCache


def overwrite(path: Path, level: float) -> None:
    """Other values in the same bytes of the same file, as a training script in the same folder would do."""
    state = {**load_file(path), "level": torch.tensor([level])}
    save_file(state, path.with_suffix(".new"))
    with path.open("r+b") as file:
        file.write(path.with_suffix(".new").read_bytes())


@pytest.mark.parametrize("member", ["base", "low"])
def test_an_overwritten_member_is_refused_wherever_it_would_be_used(tmp_path: Path, member: str) -> None:
    pool = sfkit.open_pool(flat_spec(tmp_path / "pool", {"low": 4.0}))
    evaluator = sfkit.Evaluator(pool, benchmark())
    evaluator([pool.uniform()])
    overwrite(tmp_path / "pool" / f"{member}.safetensors", 30.0)
    message = rf"{member}\.safetensors: has changed since pool 'flat' was opened \(member '{member}'\)"
    with pytest.raises(InputError, match=message):
        evaluator([pool.base_recipe()])
    with pytest.raises(InputError, match=message):
        pool.merge(pool.uniform())
    with pytest.raises(InputError, match=message):
        sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.safetensors")
    assert not (tmp_path / "m.safetensors").exists()
    assert len(evaluator.store) == 1


def test_what_changes_during_an_evaluation_stores_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool = sfkit.open_pool(flat_spec(tmp_path / "pool", {"low": 4.0}))
    evaluator = sfkit.Evaluator(pool, benchmark())
    run = evaluator.engine.worker.run  # type: ignore[union-attr] # inline
    path = tmp_path / "pool" / "base.safetensors"
    monkeypatch.setattr(evaluator.engine.worker, "run", lambda r: (run(r), overwrite(path, 30.0))[0])  # type: ignore[union-attr]
    with pytest.raises(InputError, match="has changed"):
        evaluator([pool.uniform()])
    assert len(evaluator.store) == 0


def test_the_same_content_may_be_written_again_and_moved_away(tmp_path: Path) -> None:
    pool = sfkit.open_pool(flat_spec(tmp_path / "pool", {"low": 4.0}))
    path = tmp_path / "pool" / "base.safetensors"
    shutil.copy(path, tmp_path / "copy")
    (tmp_path / "copy").replace(path)
    assert float(pool.merge(pool.base_recipe()).network.level) == 5.0
    path.rename(tmp_path / "elsewhere")
    assert float(pool.merge(pool.base_recipe()).network.level) == 5.0


def test_a_truncated_member_ends_with_a_sentence(tmp_path: Path) -> None:
    pool = sfkit.open_pool(flat_spec(tmp_path / "pool", {"low": 4.0}))
    os.truncate(tmp_path / "pool" / "base.safetensors", 40)
    with pytest.raises(InputError, match=r"base\.safetensors: has changed"):
        pool.merge(pool.base_recipe())


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> VectorCache:
    """A cache that takes networks of any size."""
    monkeypatch.setattr(members, "MAPPED_ABOVE", 0)
    return VectorCache(tmp_path / "cache")


def test_a_copy_that_keeps_its_time_is_no_old_acquaintance(tmp_path: Path, cache: VectorCache) -> None:
    """``cp -p`` onto a source: same inode, size and time of writing."""
    spec = flat_spec(tmp_path / "pool", {"low": 4.0})
    sfkit.open_pool(spec, cache=cache)
    path = tmp_path / "pool" / "low.safetensors"
    before = path.stat()
    overwrite(path, 7.0)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    pool = sfkit.open_pool(spec, cache=cache)
    assert float(pool.merge(pool.uniform()).network.level) == 7.0


def test_random_bytes_in_the_cache_are_not_merged(tmp_path: Path, cache: VectorCache) -> None:
    spec = flat_spec(tmp_path / "pool", {"low": 4.0})
    sfkit.open_pool(spec, cache=cache)
    (vector,) = cache.folder.rglob("*.f32")
    vector.write_bytes(np.float32(9.0).tobytes() * (vector.stat().st_size // 4))
    pool = sfkit.open_pool(spec, cache=cache)
    assert float(pool.merge(pool.uniform()).network.level) == 4.0


def test_samples_edited_after_the_evaluator_was_made_change_nothing() -> None:
    pair = sample("a", 5.0)
    one = memory_benchmark("one", [pair], metric="epe")
    prepared = PreparedBenchmark(one, InputConvention(), Quantities.of(Metric.parse("epe")))
    pair.disparity[:, : SIZE[1] // 2] = 9.0
    assert float(np.nanmax(prepared.samples[0].disparity)) == 5.0
    assert prepared.fingerprint != one.fingerprint()


def test_a_drawn_pair_cannot_be_edited_under_its_name() -> None:
    pair = MemoryPair("a", sample("a", 5.0), digest="seed 1")
    with pytest.raises(ValueError, match="read-only"):
        pair.sample.disparity[0, 0] = 3.0


def test_an_image_that_keeps_its_time_has_another_digest(tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    path.write_bytes(b"one")
    before, digest = path.stat(), file_digest(path)
    path.write_bytes(b"two")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert file_digest(path) != digest
