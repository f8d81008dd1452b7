"""What a checkpoint must be to join a pool, and the sentence for each way it is not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import torch

from sfkit.checkpoints.fingerprints import COUNTER
from sfkit.errors import InputError, nearest

WEIGHTS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)


class Kind(StrEnum):
    """What a tensor is to a merge."""

    WEIGHT = "weight"  # a parameter: routed, and scaled by its block's module scale
    STATISTIC = "statistic"  # a running mean or variance: routed, never scaled, always convex
    CONSTANT = "constant"  # index tables, image means, counters, dead parameters: the base's, untouched


@dataclass(frozen=True)
class TensorSpec:
    """One tensor the network has.

    Attributes:
        key: its state-dict key; of aliased keys the first.
        shape: its shape.
        kind: what it is to a merge.
        aliases: further keys of the same storage, merged once and written under each.
        optional: a source may lack it; its task vector there is zero.
        tolerant: it may be absent or differ in a source (integer buffers); the base's is kept.
        complex: it is a complex64 buffer, such as a table of rotations: the base's is kept.
    """

    key: str
    shape: tuple[int, ...]
    kind: Kind
    aliases: tuple[str, ...] = ()
    optional: bool = False
    tolerant: bool = False
    complex: bool = False

    @property
    def size(self) -> int:
        """Number of elements."""
        return torch.Size(self.shape).numel()


def check_keys(
    path: Path,
    found: Mapping[str, torch.Tensor],
    expected: Iterable[TensorSpec],
    *,
    known_extra: Iterable[str] = (),
    is_base: bool = False,
) -> tuple[str, ...]:
    """Compare a checkpoint's keys and shapes with what the network has.

    Args:
        path: named in errors.
        found: the checkpoint's tensors, by the network's key names.
        expected: the network's tensors.
        known_extra: keys the file may have though the network does not (an optional part left out).
        is_base: the base may lack nothing but counters.

    Returns:
        The keys of optional tensors that are missing.

    Raises:
        InputError: a key is missing or extra, or a shape differs; the first such key is named.
    """
    specs = tuple(expected)
    names = {name for spec in specs for name in (spec.key, *spec.aliases)}
    missing = [s for s in specs if s.key not in found and not any(a in found for a in s.aliases)]
    absent = tuple(s.key for s in missing if s.optional and not s.tolerant)
    # A source may lack what is optional, the base may not.
    fatal = [s.key for s in missing if not s.tolerant and (is_base or not s.optional)]
    extra = sorted(set(found) - names - set(known_extra))
    # A counter that no inference reads is no reason to refuse a file.
    extra = [key for key in extra if not key.endswith(COUNTER)]
    if fatal:
        more = f" (and {len(fatal) - 1} more)" if len(fatal) > 1 else ""
        raise InputError(
            f"{path}: the key {fatal[0]!r}{more} is missing, expected every tensor of the architecture"
            f"{nearest(fatal[0], extra)}"
        )
    if extra:
        more = f" (and {len(extra) - 1} more)" if len(extra) > 1 else ""
        raise InputError(
            f"{path}: found the key {extra[0]!r}{more}, which the architecture does not have: "
            "is this a checkpoint of another architecture or with other options?"
        )
    for spec in specs:
        tensor = found.get(spec.key)
        if tensor is not None and tuple(tensor.shape) != spec.shape and not spec.tolerant:
            raise InputError(
                f"{path}: {spec.key!r} has the shape {tuple(tensor.shape)}, expected {spec.shape}: "
                "all checkpoints of a pool share one architecture and its options"
            )
    return absent


def check_values(path: Path, key: str, tensor: torch.Tensor) -> None:
    """Refuse values that are not finite, and variances below 0.

    Raises:
        InputError: names the key and counts the values.
    """
    # Finite where both parts are.
    tensor = torch.view_as_real(tensor) if tensor.is_complex() else tensor
    if not tensor.is_floating_point() or not tensor.numel():
        return
    # Both ends are NaN where any value is; looking at them reads ten times as fast as isfinite of all.
    ends = torch.stack(torch.aminmax(tensor))
    if not bool(torch.isfinite(ends).all()):
        count = int((~torch.isfinite(tensor)).sum())
        raise InputError(
            f"{path}: {key!r} holds {count} values that are not finite, expected finite weights: "
            "the training that wrote it diverged"
        )
    # Batch norm takes its root: below 0 every output would be NaN.
    if key.rpartition(".")[2] == "running_var" and float(ends[0]) < 0:
        raise InputError(
            f"{path}: {key!r} holds {int((tensor < 0).sum())} variances below 0, expected none: was it made "
            "by a method that does not keep them positive?"
        )


def check_types(path: Path, found: Mapping[str, torch.Tensor], expected: Iterable[TensorSpec]) -> None:
    """Refuse tensors that are no plain numbers, or whole numbers where weights are expected.

    Raises:
        InputError: names the key and what was found.
    """
    for spec in expected:
        tensor = found.get(spec.key)
        if tensor is None:
            continue
        if spec.complex:
            kind = None if tensor.dtype == torch.complex64 else f"of {_name(tensor)}"
        else:
            kind = _not_plain(tensor)
            if kind is None and spec.kind is not Kind.CONSTANT and tensor.dtype not in WEIGHTS:
                kind = f"of {_name(tensor)}"
        if kind is not None:
            expected_types = "complex64" if spec.complex else "float16, bfloat16, float32 or float64"
            raise InputError(
                f"{path}: {spec.key!r} is {kind}, expected {expected_types} values: convert it where it was "
                "trained and save it again"
            )


def _name(tensor: torch.Tensor) -> str:
    return str(tensor.dtype).removeprefix("torch.")


def _not_plain(tensor: torch.Tensor) -> str | None:
    if tensor.layout != torch.strided:
        return f"a sparse tensor ({str(tensor.layout).removeprefix('torch.')})"
    if tensor.is_meta:
        return "without values (on the meta device)"
    if tensor.is_quantized:
        return "quantised"
    if tensor.is_complex() or (tensor.is_floating_point() and tensor.dtype not in WEIGHTS):
        return f"of {_name(tensor)}"
    return None
