"""Buffers of a network's own: the base's in every merge, and said so, or merged where the decorator says."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.errors import SfkitWarning
from sfkit.merging import Pool, open_pool


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
