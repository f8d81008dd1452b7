"""What a safetensors file says of itself, read without torch: names, types, shapes, digests and texts."""

from __future__ import annotations

import json
import math
import mmap
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from safetensors import SafetensorError, safe_open

from sfkit.checkpoints.fingerprints import content_digest
from sfkit.errors import InputError, nearest
from sfkit.files import trouble
from sfkit.outside import parse_json

if TYPE_CHECKING:
    import numpy as np

SAFETENSORS = ".safetensors"
TORCH_SUFFIXES = (".pth", ".pt", ".ckpt", ".tar", ".bin")
SUFFIXES = (SAFETENSORS, *TORCH_SUFFIXES)
INDEX = ".safetensors.index.json"  # of a network in several files: which tensor is in which
# The types networks are saved in. Files of others are read with torch.
_DTYPES = {
    "F64": "torch.float64",
    "F32": "torch.float32",
    "F16": "torch.float16",
    "BF16": "torch.bfloat16",
    "I64": "torch.int64",
    "I32": "torch.int32",
    "I16": "torch.int16",
    "I8": "torch.int8",
    "U8": "torch.uint8",
    "BOOL": "torch.bool",
}
_NUMPY = {
    name: f"<{name[0].lower()}{int(name[1:]) // 8}" for name in ("F64", "F32", "F16", "I64", "I32", "I16")
}
_BYTES = {name: 1 if name == "BOOL" else int(name.strip("BFIU")) // 8 for name in _DTYPES}
_LARGEST_HEADER = 100_000_000  # bytes, as safetensors has it


@dataclass(frozen=True)
class StoredTensor:
    """One tensor of a file.

    Attributes:
        dtype: as torch spells it.
        shape: of the tensor.
        digest: as :func:`sfkit.checkpoints.fingerprints.tensor_digest`.
    """

    dtype: str
    shape: tuple[int, ...]
    digest: str


def is_checkpoint_name(path: Path) -> bool:
    """True for a file that by its ending is a checkpoint, in capitals or not."""
    return path.suffix.lower() in SUFFIXES or path.name.endswith(INDEX)


def ensure_checkpoint(path: Path) -> None:
    """Refuse what by name and first bytes is no checkpoint, before anything is imported that could read it.

    Raises:
        InputError: the file is missing, no file, of another ending, or was saved in place of weights.
    """
    if why := trouble(path):
        beside = _nearest_file(path) if why == "no such file" else ""
        raise InputError(f"{path}: {why}, expected a checkpoint{beside}")
    if why := other_content(path):
        raise InputError(f"{path}: {why}")
    if not is_checkpoint_name(path):
        endings = ", ".join((*SUFFIXES, INDEX))
        raise InputError(f"{path}: found the ending {path.suffix!r}, expected one of {endings}")


def _nearest_file(path: Path) -> str:
    if not path.parent.is_dir():
        return f" (its folder {path.parent} does not exist)"
    return nearest(path.name, (p.name for p in path.parent.iterdir() if is_checkpoint_name(p)))


def other_content(path: Path) -> str | None:
    """What a file is that was saved in place of weights; None where nothing tells."""
    with path.open("rb") as stream:
        begin = stream.read(64).lstrip()
    if begin.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, expected the weights it stands for: fetch them with git lfs pull"
    if begin.lower().startswith((b"<!doctype", b"<html", b"<head", b"<?xml")):
        return "is a web page, expected weights: look whether the download needs a login"
    return None


def read_texts(path: Path) -> dict[str, str]:
    """The text entries of a safetensors header.

    Raises:
        InputError: the file cannot be read.
    """
    if why := trouble(path):
        raise InputError(f"{path}: {why}, expected a checkpoint")
    if why := other_content(path):
        raise InputError(f"{path}: {why}")
    texts = _sound_texts(path)
    if texts is not None:
        return texts
    try:
        with safe_open(path, framework="np") as file:
            return dict(file.metadata() or {})
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cannot be read as safetensors ({error}), expected a whole file") from error


def stored_tensors(path: Path, *, digests: bool = True) -> dict[str, StoredTensor] | None:
    """Key -> tensor of a safetensors file that :func:`read_texts` has read; None where a type is unusual.

    Without ``digests``, which are empty then, no content is read.
    """
    with path.open("rb") as file:
        start, entries = _entries(file)
        if any(entry["dtype"] not in _DTYPES for entry in entries.values()):
            return None
        if not digests:
            return {k: StoredTensor(_DTYPES[e["dtype"]], tuple(e["shape"]), "") for k, e in entries.items()}
        found = {}
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages:
            for key, entry in entries.items():
                dtype, shape = _DTYPES[entry["dtype"]], tuple(entry["shape"])
                begin, end = entry["data_offsets"]
                # Views are let go of here: a map with one left refuses to close.
                with memoryview(pages) as view, view[start + begin : start + end] as content:
                    found[key] = StoredTensor(dtype, shape, content_digest(dtype, shape, content))
        return found


def stored_arrays(path: Path) -> dict[str, np.ndarray] | None:
    """Key -> array of a safetensors file that :func:`read_texts` has read; None where numpy lacks a type.

    They are pages of the file and cannot be written to.
    """
    import numpy as np

    with path.open("rb") as file:
        start, entries = _entries(file)
    if any(entry["dtype"] not in _NUMPY for entry in entries.values()):
        return None
    pages = np.memmap(path, np.uint8, "r")
    found = {}
    for key, entry in entries.items():
        begin, end = entry["data_offsets"]
        found[key] = pages[start + begin : start + end].view(_NUMPY[entry["dtype"]]).reshape(entry["shape"])
    return found


def _entries(file: BinaryIO) -> tuple[int, dict[str, Any]]:
    """Where the content of a whole file begins, and key -> type, shape and place of each tensor."""
    start = 8 + int.from_bytes(file.read(8), "little")
    entries = json.loads(file.read(start - 8))
    entries.pop("__metadata__", None)
    return start, entries


def _sound_texts(path: Path) -> dict[str, str] | None:
    """The texts of a file that is whole by its own header, read without numpy, on which safetensors insists.

    None for every other file: safetensors says what is wrong with it.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        if not 0 < length <= min(size - 8, _LARGEST_HEADER):
            return None
        content = file.read(length)
    try:
        entries = parse_json(content, str(path))
        texts = entries.pop("__metadata__", {})
        shapes = [(entry["dtype"], entry["shape"], *entry["data_offsets"]) for entry in entries.values()]
        reached = 8 + length
        for dtype, shape, begin, end in sorted(shapes, key=lambda one: (one[2], one[3])):
            if not all(type(number) is int and number >= 0 for number in (*shape, begin, end)):
                return None  # -2 * -2 and 4.0 are as many elements, and no shape
            # Without gap or overlap, as safetensors itself demands: what is accepted here is accepted there.
            if 8 + length + begin != reached or end - begin != _BYTES[dtype] * math.prod(shape):
                return None
            reached = 8 + length + end
        plain = all(isinstance(text, str) for text in texts.values())
    except (InputError, UnicodeDecodeError, AttributeError, KeyError, TypeError, ValueError):
        return None
    return texts if reached == size and plain else None
