"""Pools of random weights in the sizes of real ones, written to disk for the time of a measurement."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from sfkit.architectures import architecture

ROOT = Path(__file__).parents[1]
STEP = 0.02  # a source's distance from the base, relative


@dataclass(frozen=True)
class PoolShape:
    """What a synthetic pool looks like.

    Attributes:
        architecture: the registry's name.
        sources: how many.
        options: the architecture's.
        frozen: prefix of keys that are equal in all sources; ``None`` for none.
    """

    architecture: str
    sources: int
    options: Mapping[str, Any] = field(default_factory=dict)
    frozen: str | None = None


@contextmanager
def temporary_folder(parent: Path | None, size: int) -> Iterator[Path]:
    """A folder outside the checkout with room for ``size`` bytes, removed however the measurement ends.

    Raises:
        SystemExit: the folder lies in the checkout, or its disk has too little room.
    """
    place = (parent or Path(tempfile.gettempdir())).resolve()
    if place.is_relative_to(ROOT):
        raise SystemExit(f"{place}: lies in the checkout, expected a folder elsewhere")
    free = shutil.disk_usage(place).free
    if free < size:
        raise SystemExit(f"{place}: {free / 1e9:.0f} GB are free, expected {size / 1e9:.0f} GB: use --folder")
    # So that it is removed then, too.
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix="sfkit-pool-") as name:
            yield Path(name)
    finally:
        signal.signal(signal.SIGTERM, before)


def base_state(shape: PoolShape) -> dict[str, torch.Tensor]:
    """The randomly initialised network's tensors; the same in every run."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return dict(architecture(shape.architecture).build(**shape.options).state_dict())


def file_size(shape: PoolShape) -> int:
    """Bytes of one checkpoint's tensors."""
    with torch.device("meta"):
        state = architecture(shape.architecture).build(**shape.options).state_dict()
    return sum(tensor.nbytes for tensor in state.values())


def write_checkpoints(folder: Path, shape: PoolShape) -> None:
    """``base.pth`` and ``s00.pth``, ``s01.pth``, ... in the layout that published checkpoints have."""
    base = base_state(shape)
    torch.save(_published(base), folder / "base.pth")
    for number in range(shape.sources):
        moved = _fine_tuned(base, shape.frozen, number + 1)
        torch.save(_published(moved), folder / f"s{number:02}.pth")


def describe(folder: Path, shape: PoolShape, sources: int) -> Path:
    """A ``pool.toml`` over the first so many sources."""
    names = [f"s{number:02}" for number in range(sources)]
    return pool_file(folder / f"pool{sources}.toml", shape.architecture, shape.options, names)


def pool_file(path: Path, kind: str, options: Mapping[str, Any], sources: Sequence[str]) -> Path:
    """Write a pool file beside ``base.pth`` and ``NAME.pth`` of each source."""
    lines = [f'name = "{path.stem}"', f'architecture = "{kind}"', "[options]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in options.items()]
    lines += ["[base]", 'file = "base.pth"']
    for name in sources:
        lines += [f"[sources.{name}]", f'file = "{name}.pth"']
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def forget_pages(folder: Path) -> None:
    """Have the operating system drop its copies of the checkpoints: the next reading is of the disk."""
    if not hasattr(os, "posix_fadvise"):
        return
    for path in folder.glob("*.pth"):
        with path.open("rb") as stream:
            os.fsync(stream.fileno())
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _published(state: Mapping[str, torch.Tensor]) -> dict[str, Any]:
    return {"model": dict(state), "global_step": 0, "epoch": 0}


def _fine_tuned(base: Mapping[str, torch.Tensor], frozen: str | None, seed: int) -> dict[str, torch.Tensor]:
    """A copy of the base with every trained tensor moved; keys of one tensor stay together."""
    generator = torch.Generator().manual_seed(seed)
    moved: dict[int, torch.Tensor] = {}
    state = dict(base)
    for key, value in base.items():
        if not value.is_floating_point() or not value.numel() or (frozen and key.startswith(frozen)):
            continue
        place = value.data_ptr()
        if place not in moved:
            scale = STEP * math.sqrt(float(value.square().mean())) + 1e-4
            noise = torch.randn(value.shape, generator=generator)
            variance = key.endswith("running_var")
            moved[place] = value * torch.exp(STEP * noise) if variance else value + scale * noise
        state[key] = moved[place]
    return state
