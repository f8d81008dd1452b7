"""Pools of random weights in the sizes of real ones, written to disk for the time of a measurement."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping
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
        published: file of the published key list under ``SFKIT_GOLDENS``, compared where it is there.
    """

    architecture: str
    sources: int
    options: Mapping[str, Any] = field(default_factory=dict)
    frozen: str | None = None
    published: str | None = None


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
    before = signal.signal(
        signal.SIGTERM, lambda *_: sys.exit("terminated")
    )  # so that it is removed then, too
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix="sfkit-pool-") as name:
            yield Path(name)
    finally:
        signal.signal(signal.SIGTERM, before)


def base_state(shape: PoolShape) -> dict[str, torch.Tensor]:
    """The randomly initialised network's tensors; the same in every run.

    Raises:
        SystemExit: its keys or shapes are not those of the published list.
    """
    with torch.random.fork_rng():
        torch.manual_seed(0)
        state = dict(architecture(shape.architecture).build(**shape.options).state_dict())
    listed = Path(os.environ.get("SFKIT_GOLDENS", "missing")) / (shape.published or "missing")
    if listed.is_file():
        published = json.loads(listed.read_text(encoding="utf-8"))
        expected = {key: tuple(entry["shape"]) for key, entry in published.items()}
        if {key: tuple(tensor.shape) for key, tensor in state.items()} != expected:
            raise SystemExit(f"{listed.name}: lists other keys or shapes than the network has")
    return state


def file_size(shape: PoolShape) -> int:
    """Bytes of one checkpoint's tensors."""
    with torch.device("meta"):
        state = architecture(shape.architecture).build(**shape.options).state_dict()
    return sum(tensor.nbytes for tensor in state.values())


def write_checkpoints(folder: Path, shape: PoolShape) -> None:
    """``base.pth`` and ``s00.pth``, ``s01.pth``, ... in the layout that published checkpoints have."""
    base = base_state(shape)
    _save(base, folder / "base.pth")
    for number in range(shape.sources):
        _save(_fine_tuned(base, shape.frozen, number + 1), folder / f"s{number:02}.pth")


def describe(folder: Path, shape: PoolShape, sources: int) -> Path:
    """A ``pool.toml`` over the first so many sources."""
    options = [f"{key} = {json.dumps(value)}" for key, value in shape.options.items()]
    lines = [f'name = "synthetic-{sources}"', f'architecture = "{shape.architecture}"', "[options]", *options]
    lines += ["[base]", 'file = "base.pth"']
    for number in range(sources):
        lines += [f"[sources.s{number:02}]", f'file = "s{number:02}.pth"']
    path = folder / f"pool{sources}.toml"
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


def _save(state: Mapping[str, torch.Tensor], path: Path) -> None:
    torch.save({"model": dict(state), "global_step": 0, "epoch": 0}, path)


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
            moved[place] = value * torch.exp(STEP * noise) if _is_variance(key) else value + scale * noise
        state[key] = moved[place]
    return state


def _is_variance(key: str) -> bool:
    return key.endswith("running_var")
