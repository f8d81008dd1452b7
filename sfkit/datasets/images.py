"""Decode image files, and refuse those that are cut off: decoders tend to fill the rest with grey."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from sfkit.datasets.pfm import read_bytes
from sfkit.errors import InputError

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_SCAN, _END = 0xDA, 0xD9  # markers after 0xFF
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # say which colours there are
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")  # in a scan, others are data and restarts
_TEXTS = frozenset((*range(0xE0, 0xF0), 0xFE))  # what applications say of an image, thumbnails among it
# In libjpeg's warnings; bytes of a scan are left over where some before them are gone or others.
_LOSSES = re.compile(
    "[Pp]remature end|bad (Huffman|arithmetic) code|instead of RST|Inconsistent prog|bytes before marker"
)
_PADDING = re.compile("([0-9]+) extraneous bytes before marker 0xd9")


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
    # Red first, and without an alpha channel.
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
    # OpenCV decodes half a file without a word.
    if not _complete(data):
        raise InputError(f"{path}: found a file that ends too early, expected a whole image; fetch it again")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error as error:
        raise InputError(f"{path}: cannot be decoded ({error}), expected an image") from error
    if pixels is None:
        raise InputError(f"{path}: found no image that can be decoded, expected PNG, JPEG, TIFF, PPM or BMP")
    if data.startswith(_JPEG) and (lost := _damage(data)) is not None:
        raise InputError(
            f"{path}: found a JPEG that lacks a part ({lost}), expected a whole image; fetch it again, or "
            "where all of a camera are so and look whole convert them to PNG"
        )
    return np.asarray(pixels)


def _complete(data: bytes) -> bool:
    if data.startswith(_PNG):
        return _png_ends(data)
    if data.startswith(_JPEG):
        return _jpeg_ends(data)
    return True


def _jpeg_ends(data: bytes) -> bool:
    """Walk the segments up to the image's own end: that of a thumbnail in one of them is another.

    A progressive image comes in several scans, each of which makes all of it finer; where some are missing,
    it looks whole and is blurred. So every frequency of every colour must have come to its last bit.
    """
    missing = _Refinements()
    for kind, at in _segments(data):
        if kind == _END:
            return not missing.left
        if kind in _FRAMES:
            # A frame names 255 colours at most, in three bytes each.
            missing.expect(data[at + 4 : at + 4 + 6 + 3 * 255], progressive=_progressive(kind))
        elif kind == _SCAN:
            missing.take(data[at + 4 : at + 4 + 16])
    return False


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Kind and place of each marker of a JPEG, from the second to its end or as far as there are some."""
    at = 2
    while 0 <= (at := data.find(b"\xff", at)) < len(data) - 1:  # padding before it is skipped by decoders
        kind = data[at + 1]
        if kind in (0x00, 0xFF):  # no marker, and filling
            at += 1
            continue
        yield kind, at
        if kind == _END:
            return
        # A segment says its own length.
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if kind == _SCAN:
            match = _MARKER.search(data, at)
            if match is None:
                return
            at = match.start()


def _progressive(frame: int) -> bool:
    return frame & 0x03 == 0x02


class _Refinements:
    """The frequencies of each colour of a JPEG that no scan has brought to their last bit yet."""

    def __init__(self) -> None:
        self._left: dict[int, set[int]] = {}
        self._progressive = False

    @property
    def left(self) -> bool:
        """True while some are missing."""
        return any(self._left.values())

    def expect(self, frame: bytes, *, progressive: bool) -> None:
        """Note the colours: a frame's content, after its length."""
        self._progressive = progressive
        count = int.from_bytes(frame[5:6], "big")  # 0 where the file ends before it is said
        self._left = {colour: set(range(64)) for colour in frame[6 : 6 + 3 * count : 3]}

    def take(self, scan: bytes) -> None:
        """Note a scan: its colours, its first and last frequency, and how many bits it leaves out."""
        end = 1 + 2 * int.from_bytes(scan[:1], "big")
        if len(scan) < end + 3:
            return
        # Elsewhere a scan is all there is of its colours, and some programs write zeros here.
        first, last, bits = scan[end : end + 3] if self._progressive else (0, 63, 0)
        for colour in scan[1:end:2] if bits & 0x0F == 0 else ():
            self._left.get(colour, set()).difference_update(range(first, last + 1))


def _damage(data: bytes) -> str | None:
    """What the scans of a JPEG lack, in libjpeg's words: decoders fill it with what came before.

    A JPEG has no checksum, so that bytes of a scan that were replaced by as many others may well be told as
    another image. Zeros between the last scan and the end, which some cameras write, lose nothing.
    """
    bare = _bare(data)
    try:
        # Grey and at an eighth of the size: every bit is read, and few pixels are made of them.
        simplejpeg.decode_jpeg(bare, "GRAY", True, True, min_factor=8)
    except ValueError as error:
        message = str(error)
        if (padding := _PADDING.search(message)) and not any(bare[-2 - int(padding[1]) : -2]):
            return None
        return message if _LOSSES.search(message) else None
    return None


def _bare(data: bytes) -> bytes:
    """The segments that make the image, with all frequencies in the scans of a plain JPEG.

    Else these, or what lies in other segments and between them, would be what libjpeg warns of, and it
    warns once. From the first scan on whatever lies between segments may be the rest of one.
    """
    bare, progressive, scans = bytearray(data[:2]), False, False
    places = list(_segments(data))
    for (kind, at), (_, following) in pairwise(places):
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if kind in _FRAMES:
            progressive = _progressive(kind)
        scans = scans or kind == _SCAN
        if kind == _SCAN and not progressive:
            # As the standard has it for a plain scan: frequencies 0 to 63, no bit left out.
            bare += data[at : end - 3] + b"\x00\x3f\x00"
        elif kind not in _TEXTS:
            bare += data[at:end]
        if scans:
            bare += data[end:following]
    return bytes(bare + data[places[-1][1] :][:2])


def _png_ends(data: bytes) -> bool:
    """Walk the chunks up to IEND."""
    at = len(_PNG)
    while at + 12 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        # A chunk's length, kind and checksum take twelve bytes beside its content.
        at += 12 + length
        if kind == b"IEND":
            return at <= len(data)
    return False
