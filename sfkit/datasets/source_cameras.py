"""Focal length times baseline where it differs from pair to pair: read from the files beside the images."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from sfkit.datasets.pfm import read_bytes
from sfkit.errors import InputError, ensure_known
from sfkit.outside import parse_json

Groups = Mapping[str, str]

FAT_BASELINE = 600.0  # 6 cm in 0.1 mm, the unit of its depths
FAT_FOCAL = 768.16058349609375  # px; what the settings file says, for folders without one
CARLA_FOCAL = 1385.64  # px at a width of 1600: 60 degrees


def constant_of(how: str, root: Path, left: Path, groups: Groups) -> str:
    """The constant of a coding for one pair, as text.

    Raises:
        InputError: an unknown ``how``, or a camera file that cannot be read.
    """
    ensure_known("constant", how, _CAMERAS)
    return f"{_CAMERAS[how](root, left, groups):.9g}"


def _falling_things(_root: Path, left: Path, _groups: Groups) -> float:
    return _fat_focal(left.parent / "_camera_settings.json") * FAT_BASELINE


@lru_cache(maxsize=64)
def _fat_focal(path: Path) -> float:
    if not path.is_file():
        return FAT_FOCAL
    settings = _json(path, read_bytes(path))
    try:
        return float(settings["camera_settings"][0]["intrinsic_settings"]["fx"])  # entry 0 is the left camera
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{path}: found no fx of the left camera ({error!r})") from error


def _stereo_carla(_root: Path, _left: Path, groups: Groups) -> float:
    return CARLA_FOCAL * float(groups["baseline"])  # the folder's number, in the depths' cm


def _dynamic_replica(root: Path, left: Path, groups: Groups) -> float:
    folder = next(p for p in left.parents if p.name == groups["split"])
    entries = _annotations(folder / f"frame_annotations_{groups['split']}.jgz")
    number, sequence = int(groups["frame"]), groups["sequence"]
    try:
        one, other = (entries[sequence, side, number] for side in ("left", "right"))
    except KeyError as error:
        raise InputError(
            f"{left}: frame_annotations_{groups['split']}.jgz has no frame {error}, fetch it again"
        ) from error
    try:
        height, width = one["image"]["size"]
        view = one["viewpoint"]
        # PyTorch3D: in isotropic NDC the shorter side spans 2, else the width does; x points left.
        side = min(height, width) if view.get("intrinsics_format") == "ndc_isotropic" else width
        focal = float(view["focal_length"][0]) * side / 2
        baseline = abs(float(other["viewpoint"]["T"][0]) - float(view["T"][0]))
        return float(focal * baseline)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(
            f"{left}: found no camera of it in frame_annotations_{groups['split']}.jgz ({error!r})"
        ) from error


@lru_cache(maxsize=4)
def _annotations(path: Path) -> dict[tuple[str, str, int], Any]:
    try:
        text = gzip.decompress(read_bytes(path))
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is no gzip file ({error}), fetch it again") from error
    entries = _json(path, text)
    try:
        return {(e["sequence_name"], e["camera_name"], int(e["frame_number"])): e for e in entries}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: an entry lacks {error}, expected Dynamic Replica's annotations") from error


def _json(path: Path, text: bytes) -> Any:
    return parse_json(text, str(path), "fetch it again")


_CAMERAS: dict[str, Callable[[Path, Path, Groups], float]] = {
    "fallingthings": _falling_things,
    "stereocarla": _stereo_carla,
    "dynamicreplica": _dynamic_replica,
}
