"""The data type that merged networks are written in, where somebody chooses one.

Rounding changes a network. So a pool whose networks will be written in a type is one whose networks are
rounded to it before they are scored: what was scored is what is written, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from sfkit.checkpoints.targets import DTYPE_NAMES
from sfkit.errors import InputError, ensure_known
from sfkit.merging.pool import Pool

DTYPES: Mapping[str, torch.dtype] = {name: getattr(torch, name) for name in DTYPE_NAMES}


def written_as(pool: Pool, dtype: str | None) -> Pool:
    """The same pool, whose merged networks hold what files of this data type hold; its files are not touched.

    Merges are summed in float32 and rounded once, tensors that no source changed are rounded too, and
    evaluations have keys of their own. ``float32`` rounds nothing: its evaluations are those of the pool.

    Args:
        pool: as it was opened or prepared.
        dtype: ``"float32"``, ``"float16"`` or ``"bfloat16"``; None leaves the pool as it is, whose networks
            are written in the base's own types where those hold the merged values, else in float32.

    Raises:
        InputError: another type, or a value of the base lies beyond its range; names the key.
    """
    if dtype is None or dtype == pool.dtype:
        return pool
    ensure_known("dtype", dtype, DTYPES)
    if pool.dtype is not None:
        raise InputError(f"dtype: pool {pool.name!r} is written as {pool.dtype} already, found {dtype}")
    kind = DTYPES[dtype]
    return replace(
        pool,
        dtype=dtype,
        base_tensors={key: within(key, tensor, kind) for key, tensor in pool.base_tensors.items()},
        # Buffers hold float32: for that type nothing is left to round.
        task_vectors=replace(pool.task_vectors, rounding=None if kind is torch.float32 else kind),
    )


def within(key: str, tensor: torch.Tensor, kind: torch.dtype) -> torch.Tensor:
    """A tensor in another floating-point type; one of whole numbers stays as it is.

    Raises:
        InputError: a finite value is infinite there.
    """
    if not tensor.is_floating_point():
        return tensor
    cast = tensor.to(kind)
    # What is too large becomes infinity without a word.
    if bool((torch.isinf(cast) & torch.isfinite(tensor)).any()):
        largest, name = torch.finfo(kind).max, str(kind).removeprefix("torch.")
        raise InputError(
            f"dtype: {key!r} has values up to {float(tensor.abs().max()):.4g}, beyond what {name} holds "
            f"({largest:.4g}), choose bfloat16 or float32"
        )
    return cast
