"""Camera calibration of a rectified pair: what turns disparity into depth and points.

Files, told apart by what they hold:

- ``calib.txt`` of Middlebury and ETH3D: ``cam0=[f 0 cx; 0 f cy; 0 0 1]``, ``baseline=`` in millimetres, and
  ``doffs=`` or ``cam1=``;
- ``calib_cam_to_cam.txt`` and ``calib/*.txt`` of KITTI: ``P_rect_02:`` or ``P2:`` and its pair, 12 numbers
  each, metres;
- ``K.txt`` as FoundationStereo's demo has it: the nine numbers of K by row, then the baseline in metres.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sfkit.datasets.pfm import read_bytes
from sfkit.errors import InputError

Size = tuple[int, int]

_MILLIMETRE = 1e-3
_LARGEST = 2**20  # bytes; such files have a few hundred
_AGREE = 0.5  # pixels by which the principal points of one file may contradict one another
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_P_ROW = re.compile(r"^P(?:_rect_)?0?(\d)\s*:(.*)$", re.MULTILINE)
_S_ROW = r"^S_rect_0{number}\s*:\s*(\S+)\s+(\S+)\s*$"
_EXPECTED = (
    "expected a Middlebury calib.txt (also ETH3D's), KITTI's matrices P2 and P3 (12 numbers each), "
    "or a K.txt (nine numbers of K, then the baseline in metres)"
)


@dataclass(frozen=True)
class Calibration:
    """depth [m] = focal [px] * baseline [m] / (disparity [px] + doffs [px]).

    Attributes:
        focal: focal length of both cameras in pixels, horizontally.
        baseline: distance of the cameras in metres.
        doffs: principal point of the right camera less that of the left in x, pixels.
        centre: principal point (x, y) of the left camera in pixels; None where it is not known, and then
            there is depth and no point cloud.
        focal_y: vertical focal length in pixels; None where pixels are square.
        size: width and height of the images it is of; None where that is not known.

    Raises:
        InputError: a focal length or the baseline is not a finite number above 0, or doffs or the principal
            point is not finite.
    """

    focal: float
    baseline: float
    doffs: float = 0.0
    centre: tuple[float, float] | None = None
    focal_y: float | None = None
    size: Size | None = None

    def __post_init__(self) -> None:
        positive = {"focal": self.focal, "baseline": self.baseline, "focal_y": self.focal_y}
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"calibration: {name} is {value:g}, expected a finite number above 0")
        # Not strict: without a centre there are fewer values than names.
        for name, value in zip(("doffs", "cx", "cy"), (self.doffs, *(self.centre or ())), strict=False):
            if not math.isfinite(value):
                raise InputError(f"calibration: {name} is {value:g}, expected a finite number")

    def check_size(self, height: int, width: int) -> None:
        """Refuse images of another size than the cameras had.

        Raises:
            InputError: the file says another size: focal length and offset would be of other pixels.
        """
        if self.size is not None and self.size != (width, height):
            found = f"{self.size[0]}x{self.size[1]}"
            raise InputError(
                f"calibration: is of images of {found} pixels, found {width}x{height}; give that of these "
                "images: scale cam0, cam1, doffs, width and height of calib.txt, or write a K.txt"
            )

    def __str__(self) -> str:
        middle = "" if self.centre is None else f", centre ({self.centre[0]:.2f}, {self.centre[1]:.2f})"
        offset = f", offset {self.doffs:.3f} px" if self.doffs else ""
        return f"focal length {self.focal:.2f} px, baseline {self.baseline:.4f} m{middle}{offset}"


def read_calibration(path: Path, cameras: tuple[int, int] | None = None) -> Calibration:
    """Read a calibration of Middlebury or ETH3D (baseline there in millimetres), of KITTI, or a ``K.txt``.

    Args:
        path: the file.
        cameras: numbers of the left and the right camera in KITTI's file; without, 2 and 3 (colour), or 0
            and 1 (grey) where these are all it has.

    Raises:
        InputError: the file cannot be read, is none of these, has an entry twice, lacks one, contradicts
            itself, is of cameras that are not rectified, or has a number that cannot be.
    """
    path = Path(path)
    data = read_bytes(path)
    if len(data) > _LARGEST:
        raise InputError(f"{path}: is {len(data)} bytes long, {_EXPECTED}")
    text = data.decode("utf-8-sig", errors="replace")
    try:
        if _P_ROW.search(text):
            return _kitti(text, cameras)
        if cameras is not None:
            raise InputError("found no rows P0 to P3, expected KITTI's matrices where cameras are named")
        # A K.txt is numbers alone, where Middlebury names its rows.
        numbers = [_float(word) for word in text.split()]
        if numbers and not any(math.isnan(number) for number in numbers):
            return _of_k(numbers)
        return _middlebury(text)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix('calibration: ')}") from error


def _middlebury(text: str) -> Calibration:
    left = _camera(text, "cam0")
    if left is None:
        raise InputError(f"found no number for 'cam0', {_EXPECTED}")
    baseline = _number(text, "baseline") * _MILLIMETRE
    right = _camera(text, "cam1")
    between = None
    if right is not None:
        if abs(right.focal - left.focal) > _AGREE:
            raise InputError(
                f"focal length is {left.focal:g} in cam0 and {right.focal:g} in cam1, expected one of both"
            )
        # Middlebury's doffs: how far the principal points lie apart in x.
        between = right.centre[0] - left.centre[0]
    if between is None or _row(text, "doffs") is not None:
        doffs = _number(text, "doffs")
        if between is not None and abs(doffs - between) > _AGREE:
            raise InputError(
                f"doffs is {doffs:g} and cam1 less cam0 is {between:g}, expected one and the same"
            )
    else:
        doffs = between
    size = None
    if _row(text, "width") is not None and _row(text, "height") is not None:
        size = (_pixels("width", _number(text, "width")), _pixels("height", _number(text, "height")))
    return replace(left.calibration(baseline, doffs), size=size)


def _kitti(text: str, cameras: tuple[int, int] | None) -> Calibration:
    rows: dict[int, Sequence[float]] = {}
    for match in _P_ROW.finditer(text):
        number, row = int(match[1]), [_float(word) for word in match[2].split()]
        if number in rows:
            raise InputError(f"has P{number} twice, expected one matrix a camera")
        if len(row) != 12 or any(math.isnan(value) for value in row):
            raise InputError(f"P{number} holds {len(row)} words, {_EXPECTED}")
        rows[number] = row
    # Colour before grey, as KITTI's own benchmarks have it.
    one, other = cameras or next((pair for pair in ((2, 3), (0, 1)) if {*pair} <= {*rows}), (2, 3))
    for number in (one, other):
        if number not in rows:
            there = ", ".join(f"P{n}" for n in sorted(rows))
            raise InputError(f"found {there} and no P{number}, expected both cameras of the pair")
    left, right = (
        # The left 3 x 3 of a 3 x 4 matrix.
        _Camera.of([*row[0:3], *row[4:7], *row[8:11]], f"P{n}")
        for n, row in ((one, rows[one]), (other, rows[other]))
    )
    # A rectified pair has one focal length and rows that match; another is no pair to measure depth by.
    if abs(right.focal - left.focal) > _AGREE or abs(right.centre[1] - left.centre[1]) > _AGREE:
        raise InputError(f"P{one} and P{other} differ in focal length or cy, expected a rectified pair")
    # P = K [I | t]: its last column is focal * t, and the right camera stands at a smaller -t.
    baseline = (rows[one][3] - rows[other][3]) / left.focal if left.focal else math.nan
    size = re.search(_S_ROW.format(number=one), text, re.MULTILINE)
    found = left.calibration(baseline, right.centre[0] - left.centre[0])
    if size is None:
        return found
    width, height = _float(size[1]), _float(size[2])
    return replace(found, size=(_pixels("S_rect", width), _pixels("S_rect", height)))


def _of_k(numbers: Sequence[float]) -> Calibration:
    if len(numbers) != 10:
        raise InputError(f"found {len(numbers)} numbers, {_EXPECTED}")
    return _Camera.of(numbers[:9], "K").calibration(numbers[9], 0.0)


@dataclass(frozen=True)
class _Camera:
    """What a 3x3 matrix says."""

    focal: float
    focal_y: float
    centre: tuple[float, float]

    @classmethod
    def of(cls, matrix: Sequence[float], name: str) -> _Camera:
        if len(matrix) != 9:
            raise InputError(f"{name} holds {len(matrix)} numbers, expected the nine of a 3x3 matrix")
        # A rectified camera has neither skew nor perspective in its matrix.
        if [matrix[n] for n in (1, 3, 6, 7, 8)] != [0, 0, 0, 0, 1]:
            raise InputError(f"{name} is {[*matrix]}, expected [f 0 cx; 0 f cy; 0 0 1]")
        return cls(matrix[0], matrix[4], (matrix[2], matrix[5]))

    def calibration(self, baseline: float, doffs: float) -> Calibration:
        vertical = None if self.focal_y == self.focal else self.focal_y
        return Calibration(self.focal, baseline, doffs, self.centre, vertical)


def _camera(text: str, name: str) -> _Camera | None:
    row = _row(text, name)
    if row is None:
        return None
    inner = re.fullmatch(r"\[(.*)\]", row)
    values = [_float(word) for word in (inner[1] if inner else row).replace(";", " ").split()]
    if inner is None or any(math.isnan(value) for value in values):
        raise InputError(f"found no number for {name!r}, {_EXPECTED}")
    return _Camera.of(values, name)


def _row(text: str, key: str) -> str | None:
    """What stands behind ``key=`` on a line of its own; None where there is no such line."""
    rows = re.findall(rf"^[ \t]*{key}[ \t]*=(.*)$", text, re.MULTILINE)
    if len(rows) > 1:
        raise InputError(f"has {key!r} twice, expected it once")
    return rows[0].strip() if rows else None


def _number(text: str, key: str) -> float:
    value = _float(_row(text, key) or "")
    if math.isnan(value):
        raise InputError(f"found no number for {key!r}, {_EXPECTED}")
    return value


def _pixels(key: str, value: float) -> int:
    if not (0 < value < 1e6 and value == int(value)):
        raise InputError(f"{key} is {value:g}, expected a number of pixels")
    return int(value)


def _float(word: str) -> float:
    """A plain decimal number; NaN for anything else, also for the words that Python reads as numbers."""
    return float(word) if _NUMBER.fullmatch(word) else math.nan
