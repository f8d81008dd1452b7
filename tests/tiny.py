"""Small worlds for tests: pools of AnyNets with a few thousand random weights, and textured stereo pairs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import torch
from safetensors.torch import save_file

from sfkit.architectures import architecture
from sfkit.datasets.pfm import write_pfm

OPTIONS = {"ranges": [4, 3, 3], "spn": False}


def base_state(seed: int = 0) -> dict[str, torch.Tensor]:
    """A randomly initialised AnyNet's tensors, its running statistics moved away from 0 and 1."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        state = architecture("anynet").build(**OPTIONS).state_dict()
        for key, tensor in state.items():
            if key.endswith("running_mean"):
                tensor.normal_(0, 0.1)
            elif key.endswith("running_var"):
                tensor.uniform_(0.5, 1.5)
    return {key: tensor.clone() for key, tensor in state.items()}


def fine_tune(base: Mapping[str, torch.Tensor], seed: int, size: float = 0.05) -> dict[str, torch.Tensor]:
    """A copy of ``base`` with every floating-point tensor moved a little; variances stay positive."""
    generator = torch.Generator().manual_seed(seed)
    moved = {}
    for key, tensor in base.items():
        if not tensor.is_floating_point():
            moved[key] = tensor.clone()
            continue
        step = torch.randn(tensor.shape, generator=generator) * size
        moved[key] = tensor * torch.exp(step) if key.endswith("running_var") else tensor + step * 0.5
    return moved


def write_pool(folder: Path, sources: int = 3, extra: str = "") -> Path:
    """A pool.toml with safetensors files beside it; sources are called a, b, c, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    base = base_state()
    save_file(base, folder / "base.safetensors")
    lines = [
        'name = "tiny"',
        'architecture = "anynet"',
        "[options]",
        "ranges = [4, 3, 3]",
        "spn = false",
        "[base]",
        'file = "base.safetensors"',
        'licence = "CC0-1.0"',
    ]
    for number in range(sources):
        name = chr(ord("a") + number)
        save_file(fine_tune(base, number + 1), folder / f"{name}.safetensors")
        lines += [f"[sources.{name}]", f'file = "{name}.safetensors"', f'licence = "licence of {name}"']
    (folder / "pool.toml").write_text("\n".join([*lines, extra]) + "\n", encoding="utf-8")
    return folder / "pool.toml"


def write_pairs(folder: Path, count: int = 2, size: tuple[int, int] = (48, 96), shift: int = 5) -> Path:
    """Folders of textured pairs whose true disparity is ``shift`` pixels wherever it is known."""
    rng = np.random.default_rng(7)
    for number in range(count):
        place = folder / f"pair{number}"
        place.mkdir(parents=True, exist_ok=True)
        wide = rng.integers(0, 256, (size[0], size[1] + shift, 3), dtype=np.uint8)
        wide = cv2.GaussianBlur(wide, (5, 5), 1.2)
        # Left pixel x shows what right pixel x - shift shows.
        cv2.imwrite(str(place / "left.png"), np.ascontiguousarray(wide[:, : size[1]]))
        cv2.imwrite(str(place / "right.png"), np.ascontiguousarray(wide[:, shift:]))
        disparity = np.full(size, float(shift), np.float32)
        disparity[:, :shift] = np.nan
        write_pfm(place / "disparity.pfm", disparity)
    return folder
