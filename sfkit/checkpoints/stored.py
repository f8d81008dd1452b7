"""A checkpoint as its file says it, read without torch: names, types, shapes, digests, texts, and arrays."""

from __future__ import annotations

import mmap
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from sfkit.checkpoints.archives import StoredPiece, TorchContent, torch_content
from sfkit.checkpoints.fingerprints import content_digest
from sfkit.checkpoints.headers import (
    SAFETENSORS,
    TORCH_SUFFIXES,
    TensorPlace,
    ensure_checkpoint,
    read_texts,
    safetensors_places,
)
from sfkit.checkpoints.layouts import Layout, common_prefix, own_texts, unwrap_any
from sfkit.errors import InputError
from sfkit.files import Signature, signature

if TYPE_CHECKING:
    import numpy as np

_NUMPY = {
    "torch.float64": "<f8",
    "torch.float32": "<f4",
    "torch.float16": "<f2",
    "torch.int64": "<i8",
    "torch.int32": "<i4",
    "torch.int16": "<i2",
}


@dataclass(frozen=True)
class StoredFile:
    """A checkpoint in which nothing is unusual.

    Attributes:
        path: the file.
        places: bare key (no ``module.``) -> where in the file its tensor is.
        layout: how the file wraps its tensors.
        metadata: the text entries of a safetensors header (how sfkit made it, if it did).
    """

    path: Path
    places: Mapping[str, TensorPlace]
    layout: Layout
    metadata: Mapping[str, str] = field(default_factory=dict)

    def digests(self) -> dict[str, str]:
        """Key -> digest, as :func:`sfkit.checkpoints.fingerprints.tensor_digest`."""
        found = {}
        with (
            self.path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages,
            memoryview(pages) as view,
        ):
            for key, place in self.places.items():
                # Views are let go of here: a map with one left refuses to close.
                with view[place.begin : place.end] as content:
                    found[key] = content_digest(place.dtype, place.shape, content)
        return found

    def arrays(self) -> dict[str, np.ndarray] | None:
        """Key -> array, pages of the file that cannot be written to; None where numpy lacks a type."""
        import numpy as np

        if any(place.dtype not in _NUMPY for place in self.places.values()):
            return None
        # Mapped, so that looking at one tensor reads its pages alone.
        pages = np.memmap(self.path, np.uint8, "r")
        return {
            key: pages[place.begin : place.end].view(_NUMPY[place.dtype]).reshape(place.shape)
            for key, place in self.places.items()
        }


def stored_file(path: Path) -> StoredFile | None:
    """What a checkpoint says of itself; None where that takes torch, which says what is unusual.

    Raises:
        InputError: no such file, or one that by name, first bytes or header is no checkpoint.
    """
    if path.suffix.lower() == SAFETENSORS:
        texts = read_texts(path)
        places = safetensors_places(path)
        if not places:
            return None
        layout = Layout(texts.get("sfkit.container") or None, common_prefix(places))
        return StoredFile(path, {key[len(layout.prefix) :]: p for key, p in places.items()}, layout, texts)
    if path.suffix.lower() not in TORCH_SUFFIXES:
        return None
    ensure_checkpoint(path)
    content = _content(path, signature(path))
    if content is None:
        return None
    try:
        pieces, layout = unwrap_any(content.value, path, StoredPiece)
    except InputError:  # torch, which is asked next, names the types of what is there instead
        return None
    found: dict[str, TensorPlace] = {}
    for key, piece in pieces.items():
        extent = content.extent(piece)
        if extent is None:
            return None
        found[key] = TensorPlace(piece.dtype, piece.shape, *extent)
    return StoredFile(path, found, layout, own_texts(path, content.value))


# The look is part of the key: a file that was written again is read again.
@lru_cache(maxsize=16)  # a folder's files are looked at several times
def _content(path: Path, _: Signature) -> TorchContent | None:
    return torch_content(path)
