"""Flat buffers that live in memory while they are small and in mapped files where they are not."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import torch

from sfkit.files import default_folder
from sfkit.merging.cache import ensure_pages

MAPPED_ABOVE = 16 << 20  # bytes; a task vector larger than this lives in a mapped file


def allocate(elements: int, *, mapped: bool, folder: Path | None = None) -> torch.Tensor:
    """A float32 tensor of shape (elements,) filled with zeros.

    A mapped buffer is a sparse file without a name: its pages are the operating system's to evict,
    only what is written takes up disk, and it is gone with the process however that ends.

    Raises:
        InputError: the disk has no room for it (:func:`~sfkit.merging.cache.ensure_pages`).
    """
    if not mapped or elements == 0:
        return torch.zeros(elements, dtype=torch.float32)
    folder = folder or default_folder() / "buffers"
    folder.mkdir(parents=True, exist_ok=True)
    # A sparse file may have any size: only a write tells that the disk is full, and ends the process.
    ensure_pages(folder, elements * 4)
    handle, name = tempfile.mkstemp(dir=folder, suffix=".f32")
    try:
        os.ftruncate(handle, elements * 4)
        return torch.from_file(name, shared=True, size=elements, dtype=torch.float32)
    finally:
        os.close(handle)
        # Nameless at once: its pages go with the last mapping, however this process ends.
        Path(name).unlink()
