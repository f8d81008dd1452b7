"""Weights for tests: NMRF filled by the rules the golden arrays were made with, no file needed."""

from __future__ import annotations

import zlib

import numpy as np
import torch
from torch import nn

CONSTANT_ENDINGS = (".mean", ".std")


def fill(network: nn.Module, rule: str) -> None:
    """Give every float tensor values that depend on its key and shape alone.

    Rule A is small everywhere; rule B keeps the scale of activations from layer to layer. Index
    buffers, empty tensors and image statistics stay as they are.
    """
    for key, tensor in network.state_dict().items():
        if tensor.is_floating_point() and tensor.numel() and not key.endswith(CONSTANT_ENDINGS):
            tensor.copy_(torch.from_numpy(_values(key, tuple(tensor.shape), rule)))


def _values(key: str, shape: tuple[int, ...], rule: str) -> np.ndarray:
    normal = np.random.RandomState(zlib.crc32(key.encode())).standard_normal(shape)
    leaf = key.rpartition(".")[2]
    scale = 0.02
    if rule == "B" and leaf == "weight":
        scale = 0.1 if len(shape) == 1 else float(np.prod(shape[1:])) ** -0.5
    values = scale * normal
    if leaf == "weight" and len(shape) == 1:
        values = 1 + values
    return values.astype(np.float32)
