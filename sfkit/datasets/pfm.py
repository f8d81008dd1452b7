"""Portable float maps (PFM): how SceneFlow, ETH3D and Middlebury store disparity.

A text header ``Pf``, width, height, scale; then 32-bit floats, bottom row first. A negative scale
means little endian; its magnitude carries no meaning for disparity and is ignored.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.files import trouble, write_bytes

_HEADER = re.compile(
    rb"(P[fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\r\n|\s)"
)
_HEADER_LIMIT = 256  # bytes; a header is a few dozen


def read_pfm(path: Path) -> NDArray[np.float32]:
    """Read a one-channel PFM as (H, W) float32, top row first, values as stored (``inf`` = unknown).

    Raises:
        InputError: not a PFM, a colour PFM, or a file whose length does not fit its header.
    """
    data = read_bytes(path)
    match = _HEADER.match(data[:_HEADER_LIMIT])
    if match is None:
        raise InputError(
            f"{path}: found no PFM header, expected a portable float map; check the file or its coding"
        )
    kind, width, height, scale = match.group(1), int(match[2]), int(match[3]), float(match[4])
    if kind == b"PF":
        raise InputError(
            f"{path}: found a colour PFM (PF), expected one channel (Pf); give the disparity file"
        )
    if width == 0 or height == 0 or scale == 0 or not math.isfinite(scale):
        raise InputError(
            f"{path}: found {width}x{height} and scale {scale}, expected a PFM with none of them 0"
        )
    # By the bytes: a file that was cut off must not become a smaller map.
    found, due = len(data) - match.end(), 4 * width * height
    if found != due:
        raise InputError(
            f"{path}: found {found} bytes of pixels, expected {due} for {width}x{height}; "
            "the file is damaged or cut off, fetch it again"
        )
    # A negative scale says that the bytes are little-endian.
    pixels = np.frombuffer(data, dtype="<f4" if scale < 0 else ">f4", offset=match.end())
    # The bottom row comes first in the file.
    return np.ascontiguousarray(pixels.reshape(height, width)[::-1], dtype=np.float32)


def write_pfm(path: Path, disparity: NDArray[np.floating]) -> None:
    """Write (H, W) as a little-endian one-channel PFM; NaN is written as ``inf``, the format's "unknown".

    Raises:
        InputError: the array is not two-dimensional, or empty.
    """
    if disparity.ndim != 2 or disparity.size == 0:
        raise InputError(f"{path}: found an array of shape {disparity.shape}, expected (H, W) to write a PFM")
    rows = np.where(np.isnan(disparity), np.inf, disparity)[::-1].astype("<f4")
    height, width = rows.shape
    write_bytes(Path(path), f"Pf\n{width} {height}\n-1\n".encode() + rows.tobytes())


def read_bytes(path: Path) -> bytes:
    """A file's content.

    Raises:
        InputError: there is no such file, or it cannot be read.
    """
    if why := trouble(Path(path)):
        raise InputError(f"{path}: cannot be read ({why}), expected a file")
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}), expected a file") from error
