"""Camera calibration of a rectified pair: what turns disparity into depth."""

from __future__ import annotations

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
    """

    focal: float
    baseline: float
    doffs: float = 0.0


def read_calibration(path: Path) -> Calibration:
    """Read a ``calib.txt`` as Middlebury 2014 and ETH3D write it (baseline there in millimetres).

    Raises:
        InputError: the file cannot be read, or lacks ``cam0`` or ``baseline``.
    """
    text = read_bytes(path).decode("utf-8", errors="replace")
    return Calibration(
        focal=_number(path, text, r"cam0\s*=\s*\[\s*([-+0-9.eE]+)"),
        baseline=_number(path, text, r"baseline\s*=\s*([-+0-9.eE]+)") * _MILLIMETRE,
        doffs=_number(path, text, r"doffs\s*=\s*([-+0-9.eE]+)"),
    )


def _number(path: Path, text: str, pattern: str) -> float:
    key = pattern.partition("\\")[0]
    match = re.search(rf"^\s*{pattern}", text, re.MULTILINE)
    try:
        if match is None:
            raise ValueError
        return float(match[1])
    except ValueError:
        raise InputError(f"{path}: found no number for {key!r}, expected a Middlebury calib.txt") from None
