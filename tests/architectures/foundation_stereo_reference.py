"""Reference material for the FoundationStereo tests: key lists, golden arrays, and weights filled by rule."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import torch
from golden_arrays import golden_arrays

from sfkit.architectures.foundation_stereo import FoundationStereo, foundation_stereo

ROOM = "foundationstereo"
MODES = {"disparity": "flash", "heads": "head"}  # our name -> the golden arrays' name

# the leaf of a key -> mean and spread of its values
_SPREAD = {
    "running_mean": (0.0, 0.05),
    "gamma": (0.2, 0.05),
    "gamma_xca": (0.2, 0.05),
    "temperature": (1.0, 0.1),
    "cls_token": (0.0, 0.1),
    "pos_embed": (0.0, 0.1),
    "mask_token": (0.0, 0.1),
    "bias": (0.0, 0.05),
}


def key_list(goldens: Path, vit_size: str) -> dict[str, tuple[tuple[int, ...], str]]:
    """Key -> (shape, dtype) of a published checkpoint."""
    content = json.loads((goldens / ROOM / f"foundationstereo_{vit_size}_keys.json").read_text())
    return {key: (tuple(entry["shape"]), entry["dtype"]) for key, entry in content.items()}


def partition(goldens: Path) -> dict[str, Any]:
    """Block prefixes, counts, dead keys and aliases of the published checkpoints."""
    content: dict[str, Any] = json.loads((goldens / ROOM / "blocks.json").read_text())
    return content


def arrays(goldens: Path, name: str) -> dict[str, np.ndarray]:
    """The golden arrays of one case."""
    return golden_arrays(goldens / ROOM / f"golden_fs_{name}.npz")


def images(case: dict[str, np.ndarray]) -> tuple[torch.Tensor, torch.Tensor]:
    """Left and right image of a case, (1, 3, H, W) float32 of 0..255."""
    left, right = (torch.from_numpy(case[side]).float() for side in ("left", "right"))
    return left, right


def skeleton(**options: Any) -> FoundationStereo:
    """The network without memory for its weights."""
    with torch.device("meta"):
        return foundation_stereo(**options)


def filled_state(vit_size: str) -> dict[str, torch.Tensor]:
    """Weights that depend on key and shape alone: the rule the golden arrays were made with."""
    return {key: _values(key, tensor) for key, tensor in skeleton(vit_size=vit_size).state_dict().items()}


def network_from(state: dict[str, torch.Tensor], **options: Any) -> FoundationStereo:
    """A network that shares the tensors of ``state``."""
    network = skeleton(**options)
    network.load_state_dict(state, strict=True, assign=True)
    return network


def _values(key: str, tensor: torch.Tensor) -> torch.Tensor:
    name = key.replace(".downsample.1.", ".norm3.") if key.startswith("cnet.") else key
    leaf, shape = name.rpartition(".")[2], tuple(tensor.shape)
    if leaf == "num_batches_tracked":
        return torch.zeros(shape, dtype=torch.int64)
    noise = np.random.RandomState(zlib.crc32(name.encode())).standard_normal(shape).astype(np.float32)
    if leaf == "running_var":
        values = 1 + 0.1 * np.abs(noise)
    elif leaf in _SPREAD or len(shape) < 2:
        mean, spread = _SPREAD.get(leaf, (1.0, 0.1))
        values = mean + spread * noise
    else:
        gain = 1.7 if len(shape) == 5 else 1.0
        values = noise * np.float32(gain / np.sqrt(np.prod(shape[1:])))
    return torch.from_numpy(values.astype(np.float32))
