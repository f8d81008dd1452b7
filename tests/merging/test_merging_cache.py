"""The cache of task vectors: a second opening reads nothing, a changed file is read again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import fine_tune, write_pool

from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.reading import CheckpointFile
from sfkit.files import signature
from sfkit.merging import cache as cache_module
from sfkit.merging import members, open_pool
from sfkit.merging.cache import FileRecord, VectorCache, VectorRecord


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> VectorCache:
    """A cache that takes networks of any size."""
    monkeypatch.setattr(members, "MAPPED_ABOVE", 0)
    return VectorCache(tmp_path / "cache")


def count_digests(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    read: list[int] = []
    digest = members.tensor_digest
    monkeypatch.setattr(members, "tensor_digest", lambda t: read.append(t.numel()) or digest(t))
    return read


def test_a_second_opening_reads_no_content(
    tmp_path: Path, cache: VectorCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_pool(tmp_path / "pool", 2)
    first = open_pool(path, cache=cache)
    read = count_digests(monkeypatch)
    second = open_pool(path, cache=cache)
    assert read == []
    assert second.identity == first.identity
    assert second.base.fingerprint == first.base.fingerprint
    assert [s.kinship for s in second.sources] == [s.kinship for s in first.sources]
    for name in first.names:
        assert torch.equal(first.vectors[name], second.vectors[name])


def test_only_what_changed_is_read_again(
    tmp_path: Path, cache: VectorCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_pool(tmp_path / "pool", 2)
    before = open_pool(path, cache=cache)
    state = load_file(tmp_path / "pool" / "base.safetensors")
    save_file(fine_tune(state, 77), tmp_path / "pool" / "b.safetensors")
    os.utime(tmp_path / "pool" / "b.safetensors", ns=(1, 1))
    read = count_digests(monkeypatch)
    after = open_pool(path, cache=cache)
    assert len(read) == len(state), "one file's tensors"
    assert after.identity["a"] == before.identity["a"]
    assert after.identity["b"] != before.identity["b"]
    assert torch.allclose(
        after.state_dict(after.equal("b"))["feature_extraction.block0.0.0.weight"],
        fine_tune(state, 77)["feature_extraction.block0.0.0.weight"],
        atol=1e-6,
    )


def test_cached_and_uncached_merges_agree(tmp_path: Path, cache: VectorCache) -> None:
    path = write_pool(tmp_path / "pool", 3)
    open_pool(path, cache=cache)
    again = open_pool(path, cache=cache)
    plain = open_pool(path, cache=VectorCache(tmp_path / "other"))
    size = plain.layout.size
    one = plain.merge_into(plain.uniform(), torch.empty(size))
    assert torch.equal(again.merge_into(again.uniform(), torch.empty(size)), one)


def opened(path: Path) -> CheckpointFile:
    return CheckpointFile(path, {}, Layout(), signatures={path: signature(path)})


def fill(cache: VectorCache, name: str, elements: int, used: float) -> None:
    with cache.writing(name, elements) as buffer:
        buffer.fill_(1.0)
    os.utime(cache.folder / "v1" / "vectors" / f"{name}.f32", (used, used))
    cache.describe(name, VectorRecord(1.0, 0.0, f"{name}.pth"))


def test_the_limit_drops_what_was_used_longest_ago(tmp_path: Path) -> None:
    cache = VectorCache(tmp_path, limit=2 * 4000)
    for number, name in enumerate(("old", "middle", "new")):
        fill(cache, name, 1000, 1000.0 + number)
    assert [(e.name, e.size_bytes, e.source) for e in cache.entries()] == [
        ("new", 4000, "new.pth"), ("middle", 4000, "middle.pth"),
    ]  # fmt: skip
    assert cache.vector("old") is None


def test_records_of_files_are_limited_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache_module, "RECORDS", 2)
    cache = VectorCache(tmp_path / "cache")
    checkpoints = [tmp_path / f"{number}.pth" for number in range(3)]
    for number, checkpoint in enumerate(checkpoints):
        checkpoint.write_bytes(b"x")
        cache.remember(opened(checkpoint), "anynet", FileRecord(f"f{number}", {}))
        (record,) = (r for r in cache.folder.rglob("*.json") if checkpoint.name in r.read_text())
        os.utime(record, (number, number))
    cache.trim()
    assert [cache.file(opened(checkpoint), "anynet") for checkpoint in checkpoints] == [
        None, FileRecord("f1", {}), FileRecord("f2", {}),
    ]  # fmt: skip


def test_a_buffer_that_was_not_finished_is_unknown(tmp_path: Path) -> None:
    cache = VectorCache(tmp_path)
    with pytest.raises(KeyboardInterrupt), cache.writing("half", 10):
        raise KeyboardInterrupt
    assert cache.vector("half") is None
    assert cache.entries() == []


def test_clearing(tmp_path: Path) -> None:
    cache = VectorCache(tmp_path)
    fill(cache, "one", 100, 5.0)
    target = tmp_path / "x.pth"
    target.write_bytes(b"x")
    cache.remember(opened(target), "anynet", FileRecord("f", {}))
    assert cache.file(opened(target), "anynet") == FileRecord("f", {})
    assert cache.file(opened(target), "other") is None
    assert cache.clear() == 400
    assert cache.file(opened(target), "anynet") is None
    assert cache.entries() == []


def test_a_torn_record_is_unknown(tmp_path: Path) -> None:
    cache = VectorCache(tmp_path)
    fill(cache, "one", 100, 5.0)
    (tmp_path / "v1" / "vectors" / "one.json").write_text("{")
    assert cache.vector("one") is None
