"""Buffers of a network's own: the base's in every merge, and said so, or merged where the decorator says."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import nn

from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging import Pool, open_pool
from sfkit.merging.dtypes import written_as
from sfkit.merging.saving import save_merged


class Gained(nn.Module):
    """A level and a gain that training moves, which is no parameter."""

    def __init__(self) -> None:
        super().__init__()
        self.level = nn.Parameter(torch.zeros(1))
        self.register_buffer("gain", torch.ones(1))
        self.register_buffer("steps", torch.zeros(1, dtype=torch.int64))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return left[:, 0] * 0 + self.level * self.gain


def pool(folder: Path, **said: object) -> Pool:
    register_architecture("gained", blocks={"all": ["level"]}, version="1", **said)(Gained)  # type: ignore[arg-type]
    for name, (level, gain) in {"base": (1.0, 1.0), "a": (2.0, 3.0), "b": (4.0, 1.0)}.items():
        steps = torch.tensor([int(level)])
        state = {"level": torch.tensor([level]), "gain": torch.tensor([gain]), "steps": steps}
        save_file(state, folder / f"{name}.safetensors")
    base, *sources = (Member(n, folder / f"{n}.safetensors") for n in ("base", "a", "b"))
    return open_pool(PoolSpec("gained", "gained", base, tuple(sources)))


def test_a_kept_buffer_is_named(tmp_path: Path) -> None:
    message = r"a\.safetensors: source 'a' has other values .* in 1 buffers \(gain\).*statistics="
    with pytest.warns(SfkitWarning, match=message) as told:
        opened = pool(tmp_path)
    assert len(told) == 1
    assert float(opened.merge(opened.equal("a")).network.gain) == 1.0  # type: ignore[arg-type]


def test_a_buffer_that_is_named_is_merged_and_never_scaled(tmp_path: Path) -> None:
    opened = pool(tmp_path, statistics=["gain"])
    recipe = opened.uniform()
    merged = opened.merge(recipe).network
    assert (float(merged.level), float(merged.gain)) == (3.0, 2.0)  # type: ignore[arg-type]


def test_a_buffer_that_does_not_matter_is_kept_in_silence(tmp_path: Path) -> None:
    opened = pool(tmp_path, constants=["gain"])
    assert float(opened.merge(opened.equal("a")).network.gain) == 1.0  # type: ignore[arg-type]


class Turned(nn.Module):
    """A level, and rotations that a transformer keeps as complex numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.level = nn.Parameter(torch.zeros(1))
        self.register_buffer("turns", torch.polar(torch.ones(2), torch.tensor([0.5, 1.0])))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return left[:, 0] * 0 + self.level * self.turns.real.sum()


def turned(folder: Path, **turns: torch.Tensor) -> Pool:
    """Sources ``a`` and ``b`` around a base at 1; each has the base's rotations unless given."""
    folder.mkdir()
    register_architecture("turned", blocks={"all": ["level"]}, version="1")(Turned)
    for name, level in {"base": 1.0, "a": 2.0, "b": 4.0}.items():
        held = turns.get(name, Turned().turns)
        save_file({"level": torch.tensor([level]), "turns": held}, folder / f"{name}.safetensors")
    base, *sources = (Member(n, folder / f"{n}.safetensors") for n in ("base", "a", "b"))
    return open_pool(PoolSpec("turned", "turned", base, tuple(sources)))


def test_complex_buffers_are_copied(tmp_path: Path) -> None:
    pool = turned(tmp_path / "pool")
    written = load_file(save_merged(pool, pool.uniform(), tmp_path / "m.safetensors"))
    assert float(written["level"]) == 3.0
    assert torch.equal(written["turns"], Turned().turns)  # type: ignore[arg-type]
    half = load_file(save_merged(written_as(pool, "float16"), pool.uniform(), tmp_path / "h.safetensors"))
    assert half["turns"].dtype == torch.complex64
    other = Turned().turns * 2  # type: ignore[operator]
    with pytest.warns(SfkitWarning, match=r"other values than the base in 1 buffers \(turns\)"):
        turned(tmp_path / "other", a=other)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (torch.tensor([1.0, complex(0, float("nan"))]), "not finite"),
        (torch.zeros(2, dtype=torch.int8), "of int8"),
    ],
)
def test_complex_buffers_are_checked(tmp_path: Path, value: torch.Tensor, said: str) -> None:
    with pytest.raises(InputError, match=f"'turns' .*{said}"):
        turned(tmp_path / "pool", b=value)
