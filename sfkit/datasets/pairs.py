"""Stereo pairs with ground truth: on disk, in memory, and loaded."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration, read_calibration
from sfkit.datasets.digests import file_digest
from sfkit.datasets.formats import read_disparity
from sfkit.datasets.images import read_grey, read_image
from sfkit.errors import InputError

VISIBLE = 255  # mask value of a pixel seen in both views (ETH3D, Middlebury)


class MaskCoding(StrEnum):
    """How a mask file says which pixels both views see."""

    EQUALS_255 = "255"  # ETH3D, Middlebury: 255 visible, 128 half-occluded, 0 unknown
    DISPARITY_16 = "disparity16"  # KITTI's disp_noc: a disparity PNG that knows visible pixels only


@dataclass(frozen=True)
class Sample:
    """One loaded pair.

    Attributes:
        id: its name within the benchmark.
        left: (H, W, 3) RGB uint8.
        right: (H, W, 3) RGB uint8.
        disparity: (H, W) float32 pixels, left view; NaN = no ground truth.
        nonoccluded: (H, W) bool, True = visible in both views; None where the data cannot tell.
        calibration: None where the data set brings none that can be read.
    """

    id: str
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    nonoccluded: NDArray[np.bool_] | None = None
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        size = self.left.shape[:2]
        self._expect("left image", self.left, (*size, 3), np.uint8)
        self._expect("right image", self.right, (*size, 3), np.uint8)
        self._expect("disparity", self.disparity, size, np.float32)
        if self.nonoccluded is not None:
            self._expect("mask", self.nonoccluded, size, np.bool_)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.disparity.shape[0], self.disparity.shape[1]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays it has, by name: images, ground truth, and the mask where there is one."""
        names = ("left", "right", "disparity", "nonoccluded")
        return {name: array for name in names if (array := getattr(self, name)) is not None}

    def _expect(self, what: str, array: NDArray[Any], shape: tuple[int, ...], dtype: type) -> None:
        if array.shape != shape or array.dtype != dtype:
            raise InputError(
                f"sample {self.id!r}: {what} is {array.dtype} of shape {array.shape}, "
                f"expected {np.dtype(dtype)} of shape {shape}"
            )


class Pair(Protocol):
    """All that an evaluation asks of a pair, wherever it lies."""

    @property
    def id(self) -> str:
        """The pair's name within its benchmark."""
        ...

    def load(self) -> Sample:
        """Images, ground truth and mask."""
        ...

    def fingerprint(self) -> str:
        """SHA-256 (hex) of the content, the id and how the files are read."""
        ...


@dataclass(frozen=True)
class StereoPair:
    """A pair on disk. ``coding`` is explained in :mod:`sfkit.datasets.formats`."""

    id: str
    left: Path
    right: Path
    disparity: Path | None
    coding: str = ""
    mask: Path | None = None
    mask_coding: MaskCoding = MaskCoding.EQUALS_255
    calibration: Path | None = None

    def load(self) -> Sample:
        """Read the files; see :func:`load`."""
        return load(self)

    def files(self) -> dict[str, Path]:
        """The files that decide a score, by role."""
        roles = {"left": self.left, "right": self.right, "disparity": self.disparity, "mask": self.mask}
        return {role: path for role, path in roles.items() if path is not None}

    def fingerprint(self) -> str:
        """SHA-256 (hex) of the files' content, the id and the codings, wherever the files lie."""
        digest = hashlib.sha256(f"{self.id}\0{self.coding}\0{self.mask_coding.value}".encode())
        for role, path in self.files().items():
            digest.update(f"\0{role}\0{file_digest(path)}".encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class MemoryPair:
    """A pair held in memory, such as a rendered one.

    ``digest`` may name the content, for pairs that are drawn from a seed, whose arrays are made read-only;
    without it the arrays are hashed.
    """

    id: str
    sample: Sample
    digest: str = ""

    def __post_init__(self) -> None:
        for array in self.sample.arrays().values() if self.digest else ():
            array.flags.writeable = False  # an edit would go under the name of what was drawn

    def frozen(self) -> MemoryPair:
        """The same with arrays of its own, which an edit of the caller's does not reach."""
        copies: dict[str, Any] = {name: array.copy() for name, array in self.sample.arrays().items()}
        return MemoryPair(self.id, replace(self.sample, **copies), self.digest)

    def load(self) -> Sample:
        """The sample itself; callers do not write into it."""
        return self.sample

    def fingerprint(self) -> str:
        """SHA-256 (hex) of the id and of ``digest``, or of the arrays."""
        digest = hashlib.sha256(f"{self.id}\0{self.digest}".encode())
        if not self.digest:
            for array in self.sample.arrays().values():
                digest.update(f"\0{array.dtype.str}{array.shape}\0".encode())
                digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def is_labelled(pair: Pair) -> bool:
    """False for a pair on disk that names no ground truth."""
    return not (isinstance(pair, StereoPair) and pair.disparity is None)


def load(pair: StereoPair) -> Sample:
    """Read a pair's images, ground truth and mask.

    Raises:
        InputError: a file is missing, damaged or coded otherwise, or two differ in size (both are named).
    """
    left, right = read_image(pair.left), read_image(pair.right)
    size = left.shape[:2]
    _expect_size(pair, pair.right, right, size)
    disparity = np.full(size, np.nan, np.float32)
    if pair.disparity is not None:
        disparity = read_disparity(pair.disparity, pair.coding)
        _expect_size(pair, pair.disparity, disparity, size)
    mask = None
    if pair.mask is not None:
        mask = read_mask(pair.mask, pair.mask_coding)
        _expect_size(pair, pair.mask, mask, size)
    calibration = None
    if pair.calibration is not None:
        with suppress(InputError):  # of another form, such as KITTI's: it decides no score
            calibration = read_calibration(pair.calibration)
    return Sample(pair.id, left, right, disparity, mask, calibration)


def read_mask(path: Path, coding: MaskCoding) -> NDArray[np.bool_]:
    """Read an occlusion mask as (H, W) bool, True = visible in both views.

    Raises:
        InputError: the file is missing, damaged, or has another depth than its coding says.
    """
    if coding is MaskCoding.DISPARITY_16:
        return np.isfinite(read_disparity(path, "png16"))
    mask = read_grey(path)
    if mask.dtype != np.uint8:
        raise InputError(f"{path}: found {mask.dtype} pixels, expected an 8-bit mask where 255 is visible")
    return np.asarray(mask == VISIBLE)


def _expect_size(pair: StereoPair, path: Path, array: NDArray[Any], size: tuple[int, ...]) -> None:
    if array.shape[:2] != size:
        raise InputError(
            f"{path}: found {array.shape[1]}x{array.shape[0]} pixels, expected {size[1]}x{size[0]} as in "
            f"{pair.left}; images, ground truth and mask of a pair must have one size"
        )
