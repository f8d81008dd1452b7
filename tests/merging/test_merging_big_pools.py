"""Big pools: task vectors that do not fit, disks that are full, tensors of several names, the benchmark."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pool
from torch import nn

from sfkit.architectures import architecture, register_architecture
from sfkit.checkpoints.checks import check_values
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.errors import InputError
from sfkit.merging import Pool, buffers, members, open_pool
from sfkit.merging.saving import save_merged
from sfkit.merging.tensor_specs import tensor_specs

ROOT = Path(__file__).parents[2]
Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Networks of any size count as big; returns the folder of cache and buffers."""
    monkeypatch.setattr(members, "MAPPED_ABOVE", 0)
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_sources_that_changed_different_tensors_share_one_layout(tmp_path: Path, mapped: Path) -> None:
    """One source froze the features: its row has zeros there, as sparse pages of an unnamed file."""
    path = write_pool(tmp_path / "pool", 2)
    base, a, b = (load_file(tmp_path / "pool" / f"{name}.safetensors") for name in ("base", "a", "b"))
    kept = {key: base[key] if key.startswith("feature_extraction") else value for key, value in b.items()}
    save_file(kept, tmp_path / "pool" / "b.safetensors")
    pool = open_pool(path)
    merged = pool.state_dict(pool.uniform())
    for key, value in merged.items():
        if value.is_floating_point():
            assert torch.allclose(value.double(), (a[key].double() + kept[key].double()) / 2, atol=1e-6), key
    assert mapped.joinpath("buffers").is_dir()
    assert not list(mapped.joinpath("buffers").iterdir()), "buffers have no name and go with the process"


@pytest.mark.parametrize("is_mapped", [True, False])
def test_buffers_begin_as_zeros(tmp_path: Path, is_mapped: bool) -> None:
    buffer = buffers.allocate(100_000, mapped=is_mapped, folder=tmp_path)
    assert not buffer.any()
    buffer.fill_(1.0)
    assert buffer.sum() == 100_000


def test_a_full_disk_is_refused_before_it_is_mapped(
    tmp_path: Path, mapped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_pool(tmp_path / "pool", 1)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(100, 95, 5))
    with pytest.raises(
        InputError, match=r"are free, expected .* MiB for a task vector: make room .*SFKIT_CACHE"
    ):
        open_pool(path)
    with pytest.raises(InputError, match="are free, expected"):
        buffers.allocate(10, mapped=True)
    assert not list(mapped.rglob("*.f32"))


class Twice(nn.Module):
    """One layer under two names."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Linear(2, 2, bias=False)
        self.second = self.first

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return left[:, 0] - right[:, 0]


def twice(folder: Path, base: dict[str, float], a: dict[str, float]) -> Pool:
    """A pool of constant weights: key -> value."""
    register_architecture("two-names", blocks={"all": ["*"]})(Twice)
    for name, values in (("base", base), ("a", a)):
        torch.save({key: torch.full((2, 2), value) for key, value in values.items()}, folder / f"{name}.pth")
    members = [Member(name, folder / f"{name}.pth") for name in ("base", "a")]
    return open_pool(PoolSpec("p", "two-names", members[0], (members[1],)))


@pytest.mark.parametrize("kept", ["first.weight", "second.weight"])
def test_a_file_with_one_of_two_names_is_merged_and_written_under_both(tmp_path: Path, kept: str) -> None:
    """Writers of safetensors drop the second name of a tensor; which one that is differs between versions."""
    both = {"first.weight": 2.0, "second.weight": 2.0}
    pool = twice(tmp_path, {kept: 1.0}, both)
    written = load_file(save_merged(pool, pool.equal("a"), tmp_path / "m.safetensors"))
    assert {key: value.unique().tolist() for key, value in written.items()} == {key: [2.0] for key in both}
    Twice().load_state_dict(written, strict=True)


def test_two_names_of_one_tensor_must_agree(tmp_path: Path) -> None:
    both = {"first.weight": 1.0, "second.weight": 1.0}
    with pytest.raises(
        InputError, match=r"a\.pth: 'first\.weight' and 'second\.weight' hold different values"
    ):
        twice(tmp_path, both, {"first.weight": 2.0, "second.weight": 3.0})


def test_reading_a_networks_keys_leaves_random_numbers_alone() -> None:
    before = torch.random.get_rng_state()
    specs = tensor_specs(architecture("nmrf-res"), architecture("nmrf-res").resolve())
    assert torch.equal(torch.random.get_rng_state(), before)
    with torch.random.fork_rng():
        built = architecture("nmrf-res").build().state_dict()
    assert {spec.key: spec.shape for spec in specs} == {key: tuple(t.shape) for key, t in built.items()}


class Picky(nn.Module):
    """Its constructor computes with the values it has drawn."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(4))
        nn.init.normal_(self.weight)
        if not self.weight.any():
            raise RuntimeError("nothing was drawn")

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return left[:, 0] - right[:, 0]


def test_a_constructor_that_needs_its_values_gets_them() -> None:
    register_architecture("picky", blocks={"all": ["*"]})(Picky)
    assert [spec.key for spec in tensor_specs(architecture("picky"), {})] == ["weight"]


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("place", [0, 517, 1000])
def test_one_bad_value_among_many_is_found(dtype: torch.dtype, value: float, place: int) -> None:
    tensor = torch.linspace(-1, 1, 1001, dtype=torch.float64).to(dtype)
    check_values(Path("x.pth"), "weight", tensor)
    tensor[place] = value
    with pytest.raises(InputError, match=r"x\.pth: 'weight' holds 1 values that are not finite"):
        check_values(Path("x.pth"), "weight", tensor)


def test_nothing_and_whole_numbers_are_finite() -> None:
    check_values(Path("x.pth"), "indicator", torch.empty(0))
    check_values(Path("x.pth"), "index", torch.tensor(3))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory by kind is read from /proc: run it on Linux")
def test_the_benchmark_measures_checks_and_cleans_up(tmp_path: Path) -> None:
    """The whole of ``benchmarks/bigpool.py`` on a small network: figures are there, files are not."""
    command = [sys.executable, str(ROOT / "benchmarks" / "bigpool.py"), "quick", "--json"]
    finished = subprocess.run(
        [*command, "--folder", str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        env=dict(os.environ),
    )
    result = json.loads(finished.stdout)
    steps = ["read files", "open first", "open again", "merge", "write"]
    rows = result["rows"]
    assert [(row["sources"], row["step"]) for row in rows] == [
        *((2, step) for step in steps),
        (2, "average"),
    ]
    assert all(row["anonymous_mb"] > 0 and row["mapped_mb"] > 0 for row in rows)
    assert all(value >= 0 for row in rows for key, value in row.items() if key.endswith("_seconds"))
    opened = next(row for row in rows if row["step"] == "open first")
    assert (opened["values"], opened["changed"]) == (6_113_210 + 7_760, 6_113_210 - 1_065_632)
    assert not list(tmp_path.iterdir())
