"""Point clouds as PLY, the Stanford polygon format: what MeshLab, CloudCompare, Blender and Open3D open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.files import write_bytes

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])  # 15 bytes a point, without gaps
_HEADER = """ply
format binary_little_endian 1.0
comment {comment}
element vertex {count}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
"""


def write_ply(
    path: Path, points: NDArray[np.floating], colours: NDArray[np.uint8], comment: str = "metres"
) -> None:
    """Write points as a binary little-endian PLY, whole or not at all.

    Args:
        path: the file.
        points: (N, 3), written as float32.
        colours: (N, 3) RGB of each.
        comment: one line of the header, ASCII.

    Raises:
        InputError: the arrays are of other shapes or the comment is of other letters.
    """
    if points.ndim != 2 or points.shape[1:] != (3,) or colours.shape != points.shape:
        raise InputError(
            f"{path}: found points {points.shape} and colours {colours.shape}, expected both (N, 3)"
        )
    if not comment.isascii() or not comment.isprintable():
        raise InputError(f"{path}: the comment is {comment!r}, expected one line of ASCII")
    vertices = np.empty(len(points), _VERTEX)
    vertices["xyz"], vertices["rgb"] = points, colours
    header = _HEADER.format(comment=comment, count=len(points))
    write_bytes(Path(path), header.encode("ascii") + vertices.tobytes())
