"""Decode image files, and refuse those that are cut off: decoders tend to fill the rest with grey."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.pfm import read_bytes
from sfkit.errors import InputError

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an 8-bit image as (H, W, 3) RGB uint8; grey is replicated, an alpha channel dropped.

    Raises:
        InputError: no image, cut off, or more than 8 bits a channel (no scaling is guessed).
    """
    pixels = decode(path)
    if pixels.dtype != np.uint8:
        raise InputError(
            f"{path}: found {pixels.dtype} pixels, expected an 8-bit image; convert it to 8 bits a channel"
        )
    if pixels.ndim == 2:
        return np.repeat(pixels[:, :, None], 3, axis=2).astype(np.uint8, copy=False)
    return np.ascontiguousarray(pixels[:, :, 2::-1]).astype(np.uint8, copy=False)


def read_grey(path: Path) -> NDArray[Any]:
    """Read a one-channel image as (H, W), in the depth it is stored in (uint8 or uint16).

    Raises:
        InputError: no image, cut off, or more than one channel.
    """
    pixels = decode(path)
    if pixels.ndim != 2:
        raise InputError(f"{path}: found {pixels.shape[2]} channels, expected a one-channel image")
    return pixels


def decode(path: Path) -> NDArray[Any]:
    """An image file's pixels as stored: (H, W) or (H, W, C) in OpenCV's BGR(A) order.

    Raises:
        InputError: the file is missing, is not an image, or is cut off.
    """
    data = read_bytes(path)
    if not _complete(data):
        raise InputError(f"{path}: found a file that ends too early, expected a whole image; fetch it again")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error as error:
        raise InputError(f"{path}: cannot be decoded ({error}), expected an image") from error
    if pixels is None:
        raise InputError(f"{path}: found no image that can be decoded, expected PNG, JPEG, TIFF, PPM or BMP")
    return np.asarray(pixels)


def _complete(data: bytes) -> bool:
    if data.startswith(_PNG):
        return _png_ends(data)
    if data.startswith(_JPEG):
        return b"\xff\xd9" in data[-64:]  # some cameras pad the end
    return True


def _png_ends(data: bytes) -> bool:
    """Walk the chunks up to IEND."""
    at = len(_PNG)
    while at + 12 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        at += 12 + length
        if kind == b"IEND":
            return at <= len(data)
    return False
