"""How well a network does on pairs of a domain: end-point error and bad pixels, mean over pairs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from sfkit.architectures import architecture
from sfkit.bank.plan import BANK, HELD_OUT_PAIRS, BankPlan
from sfkit.datasets import Sample
from sfkit.datasets.synthetic import Domain, SyntheticPair, synthetic_pair

TruePair = SyntheticPair | Sample


def held_out_pairs(domain: Domain, count: int = HELD_OUT_PAIRS) -> list[SyntheticPair]:
    """Pairs of the domain that no training sees."""
    return [synthetic_pair(domain, index, split="held-out") for index in range(count)]


def predict(network: nn.Module, pair: TruePair, of: BankPlan = BANK) -> NDArray[np.float32]:
    """The network's disparity of the left image, (H, W) float32, pixels. The network must be in eval mode."""
    prepared = architecture(of.architecture).inputs(of.options).prepare(pair.left, pair.right)
    with torch.inference_mode():
        disparity = prepared.window.crop(network(prepared.left, prepared.right))
    return np.asarray(disparity[0].numpy(), dtype=np.float32)


def errors(network: nn.Module, pairs: Sequence[TruePair], of: BankPlan = BANK) -> dict[str, float]:
    """``epe`` in pixels and ``bad3`` in percent over pixels with ground truth, mean over the pairs."""
    network.eval()
    return _mean([predict(network, pair, of) for pair in pairs], pairs)


def constant_guess(pairs: Sequence[TruePair]) -> dict[str, float]:
    """The same for the best constant: the median of all ground truth, which minimises the absolute error."""
    known = np.concatenate([pair.disparity[np.isfinite(pair.disparity)] for pair in pairs])
    value = np.float32(np.median(known))
    return _mean([np.full_like(pair.disparity, value) for pair in pairs], pairs)


def _mean(predictions: Sequence[NDArray[np.float32]], pairs: Sequence[TruePair]) -> dict[str, float]:
    offs = [
        np.abs(d - p.disparity)[np.isfinite(p.disparity)] for d, p in zip(predictions, pairs, strict=True)
    ]
    return {
        # Summed in double precision: some 70,000 pixels in float32 would lose digits that machines disagree
        # on.
        "epe": float(np.mean([off.mean(dtype=np.float64) for off in offs])),
        "bad3": float(np.mean([100.0 * (off > 3.0).mean() for off in offs])),
    }
