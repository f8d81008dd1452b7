"""Fingerprints: the identity of a checkpoint is its content, not its path or its wrapping.

The same weights as ``.pth`` with ``module.`` prefixes and as safetensors have one fingerprint, so an
evaluation store recognises them wherever they lie.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

COUNTER = "num_batches_tracked"  # batch norm's step counter: never read at inference, often absent


def tensor_digest(tensor: torch.Tensor) -> str:
    """Digest of one tensor's dtype, shape and bytes."""
    import torch

    if not tensor.numel():
        return content_digest(str(tensor.dtype), tuple(tensor.shape), b"")
    # Of a view that is negated or conjugated, the bytes it stands for.
    plain = tensor.detach().resolve_conj().resolve_neg().contiguous().reshape(-1)
    # As bytes, since numpy has no bfloat16.
    flat = plain.view(torch.uint8).numpy().data
    return content_digest(str(tensor.dtype), tuple(tensor.shape), flat)


def content_digest(dtype: str, shape: tuple[int, ...], content: bytes | memoryview) -> str:
    """The same digest from a tensor's bytes as a file holds them.

    Args:
        dtype: as torch spells it, such as ``"torch.float32"``.
        shape: of the tensor.
        content: its elements in order, little-endian.
    """
    # The same bytes in another shape or type are another tensor.
    digest = hashlib.sha256(f"{dtype}{shape}".encode())
    digest.update(content)
    return digest.hexdigest()


def fingerprint(digests: Mapping[str, str]) -> str:
    """Fingerprint of a checkpoint from its tensors' digests; the order of keys does not matter."""
    total = hashlib.sha256()
    for key in sorted(digests):
        if not key.endswith(COUNTER):
            total.update(f"{key}={digests[key]}\n".encode())
    return total.hexdigest()


def text_digest(text: str) -> str:
    """SHA-256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()
