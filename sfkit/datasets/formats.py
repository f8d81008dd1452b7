"""Disparity files of every coding in use, read into one convention.

In memory a disparity map is (H, W) float32 in pixels, positive: the left image's pixel (x, y) is seen
at (x - d, y) in the right one. What is not known is NaN, whatever the file said (0, negative, inf).

Codings:

| coding | file | disparity |
|---|---|---|
| ``pfm`` | portable float map | as stored |
| ``png16`` or ``png16:S`` | 16-bit grey PNG | value / S, S = 256 unless given |
| ``png8:S`` | 8-bit grey PNG | value / S |
| ``npy`` | numpy array | as stored |
| ``npz`` or ``npz:ENTRY`` | numpy archive | as stored; the entry may be left out where there is one |
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.images import read_grey
from sfkit.datasets.pfm import read_bytes, read_pfm
from sfkit.errors import InputError, ensure_known
from sfkit.files import write_bytes

KITTI_SCALE = 256.0
CODINGS = ("npy", "npz", "pfm", "png16", "png8")
_UNREADABLE = (
    *(ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError),
    *(tokenize.TokenError, SyntaxError, MemoryError, OverflowError, KeyError, TypeError),  # numpy's header
)
_BY_SUFFIX = {".pfm": "pfm", ".npy": "npy", ".npz": "npz"}


@dataclass(frozen=True)
class Coding:
    """How to read a disparity file: its ``kind``, the ``scale`` of integers, the ``entry`` of an archive."""

    kind: str
    scale: float = 1.0
    entry: str | None = None

    @classmethod
    def parse(cls, text: str) -> Coding:
        """Read a coding's name, such as ``pfm``, ``png16``, ``png8:4`` or ``npz:arr_0``.

        Raises:
            InputError: an unknown coding, or a scale that is missing or not a positive number.
        """
        kind, colon, rest = text.strip().partition(":")
        ensure_known("coding", kind, CODINGS)
        if kind == "npz":
            return cls(kind, entry=rest or None)
        # By itself it is KITTI's, in steps of 1/256 of a pixel.
        if kind == "png16" and not colon:
            return cls(kind, KITTI_SCALE)
        if kind in ("png8", "png16"):
            return cls(kind, _scale(text, rest))
        if colon:
            raise InputError(f"coding {text!r}: {kind} takes nothing after it, write {kind!r}")
        return cls(kind)


def coding_of_suffix(path: Path) -> str | None:
    """The coding a file's suffix settles, None for images: the scale of a PNG cannot be guessed."""
    return _BY_SUFFIX.get(Path(path).suffix.lower())


def read_disparity(path: Path, coding: str) -> NDArray[np.float32]:
    """Read a disparity file as (H, W) float32 pixels, NaN where there is no ground truth.

    Raises:
        InputError: the coding is unknown, or the file is missing, damaged or of another kind.
    """
    parsed = Coding.parse(coding)
    raw = _READERS[parsed.kind](Path(path), parsed)
    disparity = np.asarray(raw, dtype=np.float32) / np.float32(parsed.scale)
    # Zeros, negative and infinite values are how files say "unknown".
    disparity[~(np.isfinite(disparity) & (disparity > 0))] = np.nan
    return disparity


def write_disparity_png16(path: Path, disparity: NDArray[np.floating]) -> None:
    """Write (H, W) pixels as KITTI's 16-bit PNG: round(256 d), at least 1; 0 where d is unknown.

    Unknown is what is NaN, infinite, zero or negative.

    Raises:
        InputError: the array is not (H, W), or a disparity lies above 65535 / 256 = 255.996 px.
    """
    if disparity.ndim != 2 or disparity.size == 0:
        raise InputError(f"{path}: found an array of shape {disparity.shape}, expected (H, W) to write a PNG")
    known = np.isfinite(disparity) & (disparity > 0)
    steps = np.rint(np.where(known, disparity, 0).astype(np.float64) * KITTI_SCALE)
    if steps.max() > np.iinfo(np.uint16).max:
        raise InputError(
            f"{path}: found a disparity of {steps.max() / KITTI_SCALE:.2f} px, expected at most 255.99; "
            "write a PFM instead"
        )
    # 0 means unknown: what is known has at least one step.
    write_png(path, np.where(known, np.maximum(steps, 1), 0).astype(np.uint16))


def write_png(path: Path, pixels: NDArray[Any]) -> None:
    """Write (H, W) or (H, W, 3) pixels, in OpenCV's BGR order, whole or not at all, under any name.

    Raises:
        InputError: such an array is no image.
    """
    # Given a path, OpenCV ends the process at bytes that are no UTF-8.
    done, data = cv2.imencode(".png", pixels)
    if not done:
        raise InputError(f"{path}: an image of {pixels.shape} cannot be written as PNG")
    write_bytes(Path(path), np.asarray(data).tobytes())


def _scale(text: str, number: str) -> float:
    try:
        scale = float(number)
    except ValueError:
        scale = math.nan
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"coding {text!r}: expected a positive number after the colon, such as 'png8:4'")
    return scale


def _read_png(path: Path, coding: Coding) -> NDArray[Any]:
    due = np.uint8 if coding.kind == "png8" else np.uint16
    pixels = read_grey(path)
    if pixels.dtype != due:
        bits = 8 * pixels.dtype.itemsize
        raise InputError(
            f"{path}: found a {bits}-bit image, expected {8 * np.dtype(due).itemsize} bits for coding "
            f"{coding.kind!r}; give the original file, or its true coding"
        )
    return pixels


def _read_npz(path: Path, coding: Coding) -> NDArray[Any]:
    archive = _load(path)
    if not isinstance(archive, np.lib.npyio.NpzFile):
        raise InputError(f"{path}: found a single array, expected an .npz archive; its coding is 'npy'")
    with archive:
        names = archive.files
        if coding.entry is None and len(names) != 1:
            raise InputError(
                f"{path}: found the entries {names}, expected one; name it, as in 'npz:disparity'"
            )
        entry = coding.entry if coding.entry is not None else names[0]
        ensure_known(f"entry of {path}", entry, names)
        try:
            return _map(path, archive[entry])
        except _UNREADABLE as error:
            raise InputError(
                f"{path}: entry {entry!r} cannot be read ({error}), expected a plain array"
            ) from error


def _load(path: Path) -> Any:
    data = io.BytesIO(read_bytes(path))  # given a path, np.load leaves damaged archives open
    try:
        return np.load(data, allow_pickle=False)
    except _UNREADABLE as error:
        raise InputError(
            f"{path}: cannot be read ({error}), expected a numpy file of plain numbers"
        ) from error


def _map(path: Path, array: Any) -> NDArray[Any]:
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        found = f"{array.dtype} of shape {array.shape}" if isinstance(array, np.ndarray) else "an archive"
        raise InputError(f"{path}: found {found}, expected one (H, W) array of numbers")
    return array


_READERS: dict[str, Callable[[Path, Coding], NDArray[Any]]] = {
    "pfm": lambda path, _: read_pfm(path),
    "npy": lambda path, _: _map(path, _load(path)),
    "npz": _read_npz,
    **dict.fromkeys(("png8", "png16"), _read_png),
}
