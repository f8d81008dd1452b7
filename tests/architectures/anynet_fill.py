"""Weights and a pair for tests: AnyNet filled by a rule that its shipped golden arrays were made with."""

from __future__ import annotations

import math
import zlib

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

SIZE = (48, 96)
SHIFT = 5  # pixels from the right view to the left one


def fill(network: nn.Module) -> None:
    """Give every float tensor values that depend on its key and shape alone, and keep activations' scale."""
    for key, tensor in network.state_dict().items():
        if tensor.is_floating_point():
            tensor.copy_(torch.from_numpy(_values(key, tuple(tensor.shape))))


def filled_pair() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Left and right image (1, 3, height, width) as the network takes them, coarse and fine texture."""
    height, width = SIZE
    draw = np.random.RandomState(7)
    coarse = draw.standard_normal((1, 3, height // 8, width // 8 + 1))
    fine = draw.standard_normal((1, 3, height, width + 8))
    wide = coarse.repeat(8, 2).repeat(8, 3) + 0.5 * fine
    return wide[..., :width].copy(), wide[..., SHIFT : SHIFT + width].copy()


def _values(key: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    normal = np.random.RandomState(zlib.crc32(key.encode())).standard_normal(shape)
    leaf = key.rpartition(".")[2]
    if len(shape) > 1:
        values = math.sqrt(2 / np.prod(shape[1:])) * normal
    elif leaf == "running_var":
        values = 1 + 0.1 * abs(normal)
    else:
        values = 0.1 * normal + (leaf == "weight")
    return values.astype(np.float32)
