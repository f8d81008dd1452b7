"""Ground truth of training sets: disparity and depth in the codings their authors chose.

Beside the codings of :mod:`sfkit.datasets.formats` there are

| coding | file | disparity in pixels |
|---|---|---|
| ``pfm-abs`` | portable float map | the absolute value (one release of FlyingThings3D is negative) |
| ``sintel`` | 8-bit RGB PNG | 4 R + G / 64 + B / 16384 |
| ``fsd`` | 8-bit RGB PNG | (255^2 R + 255 G + B) / 1000 |
| ``dsp5`` | HDF5, dataset ``disparity``, twice the image's size | every second row and column, as stored |
| ``depth16:C:F`` | 16-bit grey PNG | C / value; F and beyond is too far to be known |
| ``depth-npy:C:F`` | numpy array | the same |
| ``depth-half:C:F`` | 16-bit grey PNG that holds float16 bits | the same; below 1e-5 nothing is known |
| ``depth-float:C:F`` | PNG of four 8-bit channels that hold a float32 | the same |

C is focal length [px] times baseline in the unit of the stored depth. What is known is decided on the
stored value, before any division: a stored 0 would otherwise become an infinite disparity that passes for a
positive one.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.formats import read_disparity
from sfkit.datasets.images import decode, read_grey
from sfkit.datasets.pfm import read_bytes, read_pfm
from sfkit.errors import InputError

Map = NDArray[np.float32]
NEAREST = 1e-5  # Dynamic Replica's authors take a depth below for unknown


def read_source_disparity(path: Path, coding: str) -> Map:
    """Read ground truth of any coding as (H, W) float32 disparity in pixels, NaN where nothing is known.

    Raises:
        InputError: the coding is unknown, or the file is missing, damaged or of another kind.
    """
    kind, _, rest = coding.partition(":")
    if kind in _DISPARITIES:
        value = np.asarray(_DISPARITIES[kind](path), dtype=np.float32)
        return np.where(np.isfinite(value) & (value > 0), value, np.float32(np.nan))
    if kind in _DEPTHS:
        constant, far = _numbers(coding, rest)
        stored = _DEPTHS[kind](path).astype(np.float64)
        known = np.isfinite(stored) & (stored > (NEAREST if kind == "depth-half" else 0)) & (stored < far)
        # By 1 where nothing is known: a division by zero would warn, and its result is not taken.
        return np.where(known, constant / np.where(known, stored, 1.0), np.nan).astype(np.float32)
    return read_disparity(path, coding)


def _numbers(coding: str, rest: str) -> tuple[float, float]:
    constant, _, far = rest.partition(":")
    try:
        numbers = float(constant), float(far) if far else math.inf
    except ValueError:
        numbers = math.nan, math.nan
    if not (math.isfinite(numbers[0]) and numbers[0] > 0 and numbers[1] > 0):
        raise InputError(
            f"coding {coding!r}: expected focal length times baseline, and the depth from which on "
            "nothing is known, such as 'depth16:38623.03:65535'"
        )
    return numbers


def _channels(path: Path, count: int) -> NDArray[np.uint8]:
    """(H, W, count) uint8 in OpenCV's order, blue first."""
    pixels = decode(path)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != count:
        raise InputError(
            f"{path}: found {pixels.dtype} of shape {pixels.shape}, expected {count} channels of 8 bits"
        )
    return pixels


def _sintel(path: Path) -> NDArray[Any]:
    # Wide first: four times red exceeds eight bits.
    blue, green, red = np.moveaxis(_channels(path, 3).astype(np.float64), -1, 0)
    return np.asarray(4 * red + green / 64 + blue / 16384)


def _fsd(path: Path) -> NDArray[Any]:
    blue, green, red = np.moveaxis(_channels(path, 3).astype(np.float64), -1, 0)
    # In thousandths of a pixel, written to the base of 255.
    return np.asarray((65025 * red + 255 * green + blue) / 1000)


def _dsp5(path: Path) -> NDArray[Any]:
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: reading it needs h5py, which is not installed: pip install 'sfkit[spring]'"
        ) from error
    data = io.BytesIO(read_bytes(path))
    try:
        with h5py.File(data, "r") as file:
            values = np.asarray(file["disparity"])
    except Exception as error:  # a group of that name, or what the bytes come to
        raise InputError(f"{path}: cannot be read ({error}), expected HDF5 with 'disparity' in it") from error
    if values.ndim != 2 or values.dtype.kind != "f":
        raise InputError(f"{path}: found {values.dtype} of shape {values.shape}, expected floats (2 H, 2 W)")
    return values[::2, ::2]  # in pixels of the image already, so never halved (the authors' FAQ)


def _depth16(path: Path) -> NDArray[Any]:
    pixels = read_grey(path)
    if pixels.dtype != np.uint16:
        raise InputError(f"{path}: found {pixels.dtype} pixels, expected a 16-bit image")
    return pixels


def _depth_npy(path: Path) -> NDArray[Any]:
    try:
        values = np.load(io.BytesIO(read_bytes(path)), allow_pickle=False)
    except Exception as error:  # numpy raises what the bytes come to
        raise InputError(f"{path}: cannot be read ({error}), expected a numpy array of depths") from error
    if not isinstance(values, np.ndarray) or values.ndim != 2 or values.dtype.kind not in "fiu":
        raise InputError(f"{path}: found no (H, W) array of numbers, expected one")
    return values


def _depth_half(path: Path) -> NDArray[Any]:
    # Half floats, stored as if they were grey values.
    return _depth16(path).view(np.float16)


def _depth_float(path: Path) -> NDArray[Any]:
    # A float's four bytes are the four channels.
    return np.ascontiguousarray(_channels(path, 4)).view("<f4")[..., 0]


_DISPARITIES: dict[str, Callable[[Path], NDArray[Any]]] = {
    "pfm-abs": lambda path: np.abs(read_pfm(path)),
    "sintel": _sintel,
    "fsd": _fsd,
    "dsp5": _dsp5,
}
_DEPTHS: dict[str, Callable[[Path], NDArray[Any]]] = {
    "depth16": _depth16,
    "depth-npy": _depth_npy,
    "depth-half": _depth_half,
    "depth-float": _depth_float,
}
