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
# Elements of every task vector that merge_many gathers at a time, 256 KiB each: with fewer, calls cost more
# than the cache saves.
GATHER = 1 << 17


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
        used = [(vectors[e], c) for e, c in enumerate(coefficients) if c != 0.0]
        weighted_sum(base, used, out, segment.start, segment.stop)


def merge_many(
    recipes: Sequence[Recipe],
    layout: FlatLayout,
    base: torch.Tensor,
    vectors: Sequence[torch.Tensor],
    out: torch.Tensor,
) -> None:
    """Merge several recipes while the task vectors pass by once.

    A chunk of every task vector is gathered in the cache and multiplied by all recipes' coefficients, so
    that R recipes move (E + 1 + R) P floats instead of R (E + 2) P. The products are summed in another
    order than :func:`merge_flat` does, hence the results agree to rounding, not to the last bit.

    Args:
        recipes: R of them, over the sources of ``vectors`` in that order.
        layout: of all the buffers.
        base: (P,) float32; not written.
        vectors: E task vectors of shape (P,), float32; not written.
        out: (R, P) float32, overwritten.
    """
    scratch = torch.empty(len(vectors) * GATHER, dtype=torch.float32)
    for segment in layout.segments:
        weights = torch.tensor([_coefficients(recipe, segment) for recipe in recipes], dtype=torch.float32)
        used = [e for e in range(len(vectors)) if bool((weights[:, e] != 0).any())]
        weights = weights[:, used].contiguous()
        for first in range(segment.start, segment.stop, GATHER):
            part = slice(first, min(first + GATHER, segment.stop))
            target, width = out[:, part], part.stop - part.start
            if not used:
                target.copy_(base[part])
                continue
            chunks = [vectors[e][part] for e in used]
            gathered = scratch[: len(used) * width].view(len(used), width)
            torch.stack(chunks, out=gathered)
            torch.addmm(base[part], weights, gathered, out=target)


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
        torch.add(base[part], terms[0][0][part], alpha=terms[0][1], out=target)
        for vector, coefficient in terms[1:]:
            target.add_(vector[part], alpha=coefficient)


def _coefficients(recipe: Recipe, segment: Segment) -> list[float]:
    """What each task vector is multiplied by in one segment."""
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
