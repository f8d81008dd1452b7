"""What a safetensors file says of itself, read without torch: names, types, shapes, places and texts."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from safetensors import SafetensorError, safe_open

from sfkit.errors import InputError, nearest
from sfkit.files import trouble
from sfkit.outside import parse_json

SAFETENSORS = ".safetensors"
WRITTEN_SUFFIXES = (".pth", ".pt", ".ckpt", ".tar")  # of torch files that are written here
TORCH_SUFFIXES = (*WRITTEN_SUFFIXES, ".bin")
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
# Names say the bits, such as F16 and I64; a BOOL takes a byte.
_BYTES = {name: 1 if name == "BOOL" else int(name.strip("BFIU")) // 8 for name in _DTYPES}
_LARGEST_HEADER = 100_000_000  # bytes, as safetensors has it


@dataclass(frozen=True)
class TensorPlace:
    """A tensor in a file.

    Attributes:
        dtype: as torch spells it, such as ``"torch.float32"``.
        shape: of the tensor.
        begin: byte of the file at which its elements begin; they follow in order, little-endian.
        end: the byte behind them.
    """

    dtype: str
    shape: tuple[int, ...]
    begin: int
    end: int


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
    # Archives, pickles and tar files all have bytes that no text has.
    if path.suffix.lower() in TORCH_SUFFIXES and begin and begin.isascii() and _is_text(begin.decode()):
        return f"is a text that begins {begin[:20].decode()!r}, expected weights"
    return None


def _is_text(begin: str) -> bool:
    return all(sign.isprintable() or sign.isspace() for sign in begin)


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


def safetensors_places(path: Path) -> dict[str, TensorPlace] | None:
    """Key -> place of a safetensors file that :func:`read_texts` has read; None where a type is unusual."""
    with path.open("rb") as file:
        start, entries = _entries(file)
    if any(entry["dtype"] not in _DTYPES for entry in entries.values()):
        return None
    return {
        key: TensorPlace(_DTYPES[e["dtype"]], tuple(e["shape"]), *(start + n for n in e["data_offsets"]))
        for key, e in entries.items()
    }


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
