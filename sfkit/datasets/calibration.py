"""Camera calibration of a rectified pair: what turns disparity into depth."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from sfkit.datasets.pfm import read_bytes
from sfkit.errors import InputError

_MILLIMETRE = 1e-3


@dataclass(frozen=True)
class Calibration:
    """depth [m] = focal [px] * baseline [m] / (disparity [px] + doffs [px]).

    ``doffs`` is the difference of the two principal points in x.

    Raises:
        InputError: focal length or baseline is not a finite number above 0, or doffs is not finite.
    """

    focal: float
    baseline: float
    doffs: float = 0.0

    def __post_init__(self) -> None:
        for name in ("focal", "baseline"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"calibration: {name} is {value:g}, expected a finite number above 0")
        if not math.isfinite(self.doffs):
            raise InputError(f"calibration: doffs is {self.doffs:g}, expected a finite number")


def read_calibration(path: Path) -> Calibration:
    """Read a ``calib.txt`` as Middlebury 2014 and ETH3D write it (baseline there in millimetres).

    Raises:
        InputError: the file cannot be read, lacks one of ``cam0``, ``baseline`` and ``doffs``, or has a focal
            length or baseline that is not a finite number above 0.
    """
    text = read_bytes(path).decode("utf-8-sig", errors="replace")
    values = {
        "focal": _number(path, text, r"cam0\s*=\s*\[\s*([-+0-9.eE]+)"),
        "baseline": _number(path, text, r"baseline\s*=\s*([-+0-9.eE]+)") * _MILLIMETRE,
        "doffs": _number(path, text, r"doffs\s*=\s*([-+0-9.eE]+)"),
    }
    try:
        return Calibration(**values)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix('calibration: ')}") from error


def _number(path: Path, text: str, pattern: str) -> float:
    key = pattern.partition("\\")[0]
    match = re.search(rf"^\s*{pattern}", text, re.MULTILINE)
    try:
        if match is None:
            raise ValueError
        return float(match[1])
    except ValueError:
        raise InputError(f"{path}: found no number for {key!r}, expected a Middlebury calib.txt") from None
