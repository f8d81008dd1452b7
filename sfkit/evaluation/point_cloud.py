"""From disparity to depth and to points in front of the left camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.ply import write_ply
from sfkit.errors import InputError

AXES = "sfkit: metres in front of the left camera; x right, y down, z forward"


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points with their colours.

    Attributes:
        points: (N, 3) float32 in metres from the left camera: x to the right, y down, z forward.
        colours: (N, 3) RGB uint8.
    """

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]

    def write(self, path: str | Path) -> Path:
        """Write a binary PLY file and return its path."""
        write_ply(Path(path), self.points, self.colours, AXES)
        return Path(path)


def depth_of(disparity: NDArray[np.float32], calibration: Calibration) -> NDArray[np.float32]:
    """Depth (H, W) in metres; infinite where disparity plus offset is not a finite number above 0.

    Raises:
        InputError: the calibration is of images of another size.
    """
    calibration.check_size(*disparity.shape)
    shifted = disparity + calibration.doffs
    # What divides by 0 here is infinitely far, and set so below.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = calibration.focal * calibration.baseline / shifted
    return np.where((shifted > 0) & np.isfinite(shifted), depth, np.inf).astype(np.float32)


def point_cloud(
    disparity: NDArray[np.float32],
    image: NDArray[np.uint8],
    calibration: Calibration,
    *,
    farthest: float | None = None,
    keep: NDArray[np.bool_] | None = None,
) -> PointCloud:
    """A point for each pixel whose depth Z is known: X = (x - cx) Z / f and Y = (y - cy) Z / f.

    Args:
        disparity: (H, W) in pixels of the left image.
        image: the left image, (H, W, 3) RGB uint8, which gives the colours.
        calibration: of images of this size, with the principal point.
        farthest: points behind this depth in metres are left out.
        keep: (H, W); pixels where it is False are left out.

    Raises:
        InputError: the principal point is not known, or image or calibration are of another size.
    """
    centre = ensure_centre(calibration)
    if image.shape != (*disparity.shape, 3):
        raise InputError(f"image: has the shape {image.shape}, expected {(*disparity.shape, 3)}")
    # x and y grow with the depth: float32 would lose millimetres far away.
    depth = depth_of(np.asarray(disparity), calibration).astype(np.float64)
    known = np.isfinite(depth) & (depth <= (np.inf if farthest is None else farthest))
    if keep is not None:
        known &= keep
    rows, columns = np.nonzero(known)
    z = depth[known]
    x = (columns - centre[0]) * z / calibration.focal
    # Pixels that are no squares have a focal length in either direction.
    y = (rows - centre[1]) * z / (calibration.focal_y or calibration.focal)
    return PointCloud(np.stack([x, y, z], axis=1).astype(np.float32), image[known])


def ensure_centre(calibration: Calibration) -> tuple[float, float]:
    """The principal point.

    Raises:
        InputError: it is not known.
    """
    if calibration.centre is None:
        raise InputError(
            "a point cloud needs the principal point, which focal length and baseline do not say: give a "
            "calibration file, such as a K.txt (the nine numbers of K, then the baseline in metres)"
        )
    return calibration.centre
