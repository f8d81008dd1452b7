"""What ``sfkit show`` keeps of a pool: the same answer without a file read, and never that of other files."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pool

from sfkit.checkpoints.spec import PoolSpec, read_pool_spec
from sfkit.merging import known
from sfkit.merging.cache import VectorCache


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As in a process that has not imported the registry, with a cache of its own."""
    monkeypatch.setattr(known, "nobody_registered", lambda: True)
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def spec(tmp_path: Path) -> PoolSpec:
    return read_pool_spec(write_pool(tmp_path / "pool", sources=3))


def kept(tmp_path: Path) -> list[Path]:
    return list((tmp_path / "cache" / "relations").glob("*"))


def test_a_pool_is_read_once(spec: PoolSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = known.relations(spec)
    assert first is not None
    assert len(kept(tmp_path)) == 1

    def read_again(*_: object) -> None:
        raise AssertionError("a file was read again")

    monkeypatch.setattr(known, "_relations", read_again)
    assert known.relations(spec) == first


def _weights(path: Path) -> None:
    state = load_file(path)
    key = next(key for key in state if key.endswith("weight") and state[key].ndim >= 2)
    state[key] = state[key] + 0.01 * torch.ones_like(state[key])
    save_file(state, path)


def _cut(path: Path) -> None:
    path.write_text(path.read_text(encoding="utf-8")[:40], encoding="utf-8")


@pytest.mark.parametrize("which", [0, 2])
def test_another_file_is_read(spec: PoolSpec, tmp_path: Path, which: int) -> None:
    first = known.relations(spec)
    _weights(spec.sources[which].path)
    second = known.relations(spec)
    assert first is not None
    assert second is not None
    changed = {name for name, kinship in second.kinships.items() if kinship != first.kinships[name]}
    assert changed == {spec.sources[which].name}
    shutil.rmtree(tmp_path / "cache")
    assert known.relations(spec) == second


def _nothing_may_be_written(place: Path) -> None:
    shutil.rmtree(place.parent.parent)
    place.parent.parent.write_text("a file where the folder should be")


@pytest.mark.parametrize(
    "harm",
    [
        _cut,
        lambda place: place.write_text("[1, 2]"),
        lambda place: place.write_text('{"kinships": {}, "blocks": {}}'),
        lambda place: place.write_bytes(b"\xff\xfe"),
        _nothing_may_be_written,
    ],
    ids=["cut", "a list", "nothing in it", "no text", "no folder"],
)
def test_a_damaged_note_is_worked_out_anew(
    spec: PoolSpec, tmp_path: Path, harm: Callable[[Path], object]
) -> None:
    first = known.relations(spec)
    harm(kept(tmp_path)[0])
    assert known.relations(spec) == first


def test_a_file_that_is_replaced_while_it_is_read_is_not_remembered(
    spec: PoolSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = known._relations

    def replaced(*arguments: Any) -> known.Relations | None:
        found = read(*arguments)
        _weights(spec.sources[0].path)
        return found

    monkeypatch.setattr(known, "_relations", replaced)
    known.relations(spec)
    assert kept(tmp_path) == []


def test_what_is_kept_can_be_cleared(spec: PoolSpec, tmp_path: Path) -> None:
    known.relations(spec)
    VectorCache().clear()
    assert kept(tmp_path) == []
