"""Linear merging: the base plus a weighted sum of task vectors, segment by segment.

StereoFactory eq. 12 for parameters; section 4.4, "Batch Normalization Handling", for running statistics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from sfkit.checkpoints.checks import Kind
from sfkit.merging.blocks import OUTSIDE
from sfkit.merging.flat import FlatLayout, Segment
from sfkit.merging.recipe import Recipe

# 1 Mi floats are 4 MiB: the output chunk stays in the last cache while every task vector's chunk is added to
# it, so that each byte of the task vectors crosses the memory bus once. Smaller chunks would stay in a core's
# own cache, but calls, and threads waiting for each other, then cost more than that saves.
CHUNK = 1 << 20


def merge_flat(
    recipe: Recipe, layout: FlatLayout, base: torch.Tensor, vectors: Sequence[torch.Tensor], out: torch.Tensor
) -> None:
    """Write the merged parameters into ``out``.

    Args:
        recipe: weights and scales, over the same sources as ``vectors`` and in the same order.
        layout: of all the buffers.
        base: (P,) float32, the base's values; not written.
        vectors: E task vectors of shape (P,), float32; not written. A source whose weight is 0
            everywhere is not read.
        out: (P,) float32, overwritten; must not share memory with ``base``.
    """
    for segment in layout.segments:
        coefficients = _coefficients(recipe, segment)
        # A source without weight is not read: of a big pool its pages may still lie on disk.
        used = [(vectors[e], c) for e, c in enumerate(coefficients) if c != 0.0]
        weighted_sum(base, used, out, segment.start, segment.stop)


def weighted_sum(
    base: torch.Tensor,
    terms: Sequence[tuple[torch.Tensor, float]],
    out: torch.Tensor,
    start: int,
    stop: int,
) -> None:
    """``out[start:stop] = base + sum of coefficient * vector``, terms added in the order given."""
    for first in range(start, stop, CHUNK):
        part = slice(first, min(first + CHUNK, stop))
        target = out[part]
        if not terms:
            target.copy_(base[part])
            continue
        # The first term is added while the base is copied: one pass over the output fewer.
        torch.add(base[part], terms[0][0][part], alpha=terms[0][1], out=target)
        for vector, coefficient in terms[1:]:
            target.add_(vector[part], alpha=coefficient)


def _coefficients(recipe: Recipe, segment: Segment) -> list[float]:
    """What each task vector is multiplied by in one segment."""
    # What lies in no block goes by the first one's weights, unscaled.
    block = 0 if segment.block == OUTSIDE else segment.block
    weights = recipe.weights[block]
    if segment.kind is Kind.STATISTIC:
        return convex(weights)
    scale = 1.0 if segment.block == OUTSIDE else recipe.scales[block]
    return [scale * weight for weight in weights]


def convex(weights: Sequence[float]) -> list[float]:
    """Weights for running statistics: divided by their sum where it exceeds 1.

    base + min(1, s) * sum (w / s) tau with s = sum w; a variance so merged is a convex combination of
    variances and stays positive, where plain task arithmetic drives it below zero.
    """
    total = math.fsum(weights)
    return [weight / total for weight in weights] if total > 1.0 else list(weights)
