"""Pairs in a folder of any origin: one sub-folder a pair, with file names in common use.

| left | right | disparity |
|---|---|---|
| ``im0`` | ``im1`` | ``disp0GT``, ``disp0`` |
| ``im2`` | ``im6`` | ``disp2`` |
| ``view1`` | ``view5`` | ``disp1`` |
| ``left`` | ``right`` | ``disp``, ``disparity``, ``disp_left``, ``disparity_left``, ``gt`` |
| ``scene1.row3.col3`` | ``scene1.row3.col4`` | ``truedisp.row3.col3`` |
| ``NAME_left`` | ``NAME_right`` | ``NAME_disp``, ``NAME_disparity``, the same with ``_left`` |

A ``pairs.toml`` in the folder or in a sub-folder may set ``left``, ``right``, ``disparity``, ``mask``
(file names) and ``coding``; that of the sub-folder comes first. The scale of an image cannot be guessed,
so ground truth in PNG, PGM or TIFF needs a coding.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sfkit.datasets.formats import Coding, coding_of_suffix
from sfkit.datasets.listing import NEEDED, PairListing, inside
from sfkit.datasets.pairs import StereoPair
from sfkit.errors import InputError, nearest
from sfkit.outside import read_toml

HINTS = "pairs.toml"
FILE_HINTS = ("left", "right", "disparity", "mask")
HINT_KEYS = (*FILE_HINTS, "coding")
IMAGES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff")
SCALED = (".png", ".pgm", ".tif", ".tiff")
DISPARITIES = (".npy", ".npz", ".pfm", *SCALED)
MASKS = ("mask0nocc", "nocc", "mask")
CONVENTIONS = (
    ("im0", "im1", ("disp0GT", "disp0")),
    ("im2", "im6", ("disp2",)),
    ("view1", "view5", ("disp1",)),
    ("left", "right", ("disp", "disparity", "disp_left", "disparity_left", "gt")),
    ("scene1.row3.col3", "scene1.row3.col4", ("truedisp.row3.col3",)),
)


def find_in_folders(root: Path, coding: str | None = None) -> PairListing:
    """The pairs in the sub-folders of ``root``, or in ``root`` itself where it holds the images.

    ``coding`` is used for the ground truth whose suffix it fits, in the place of any hint.

    Raises:
        InputError: a folder is ambiguous, a PNG has no coding, a hint is wrong or leads outside.
    """
    hints = _hints(root)
    pairs, missing, strange, broken = [], {}, [], []
    entries = [f for f in sorted(root.iterdir()) if not f.name.startswith(".")]
    folders = [f for f in entries if f.is_dir()]
    links = [f.name for f in entries if f.is_symlink() and not f.exists()]
    # The folder itself first: it may be one pair.
    for folder in [root, *folders]:
        inside(root, folder)
        # A folder's own hints come before those of the root.
        own = hints if folder == root else {**hints, **_hints(folder)}
        roles = _roles(folder, own)
        if "left" not in roles:
            if folder != root:
                strange.append(folder.name)
                broken += [folder.name] if _has_images(folder) else []
            continue
        lacking = tuple(f"{folder.name}: the {role} file" for role in NEEDED if role not in roles)
        if lacking:
            missing[folder.name] = lacking
        else:
            files: dict[str, Any] = {role: inside(root, path) for role, path in roles.items()}
            told = coding_for(files["disparity"], [coding, own.get("coding")])
            pairs.append(StereoPair(folder.name, coding=told, **files))
    note = (f"no pair was recognised in: {', '.join(strange)}",) if strange else ()
    notes = [f"no pair was recognised among the images in: {', '.join(broken)}"] if broken else []
    notes += [f"links that lead nowhere, or in a circle: {', '.join(links)}"] if links else []
    return PairListing(tuple(pairs), missing, note, tuple(notes))


def _has_images(folder: Path) -> bool:
    """Whether a folder holds an image, a link to nowhere, or hints, so that somebody meant it as a pair."""
    return any(
        (path.suffix.lower() in IMAGES and (path.is_file() or path.is_symlink())) or path.name == HINTS
        for path in folder.iterdir()
    )


def nothing_recognised(root: Path, found: PairListing) -> str:
    """The sentence for a folder without one complete pair."""
    if found.missing:
        what = "no complete pair, without " + "; ".join(f for files in found.missing.values() for f in files)
    else:
        what = "no pair with file names in common use"
    names = ", ".join(f"{left}/{right}" for left, right, _ in CONVENTIONS)
    return (
        f"{root}: found {what}; expected sub-folders with {names} or *_left/*_right and a disparity file; "
        f"name the files in a {HINTS}, or list them in a CSV with the columns left, right, disparity"
    )


def coding_for(path: Path, given: Iterable[str | None]) -> str:
    """The first coding of ``given`` that fits the file's suffix, else the one the suffix settles.

    Raises:
        InputError: an image of unknown scale.
    """
    suffix = path.suffix.lower()
    for coding in given:
        # png8 and png16 are files of one kind.
        kind = Coding.parse(coding).kind.rstrip("0123456789") if coding else ""
        if coding and suffix in (SCALED if kind == "png" else (f".{kind}",)):
            return coding
    settled = coding_of_suffix(path)
    if settled is None:
        raise InputError(
            f"{path}: found no coding for this ground truth, and the scale of an image cannot be guessed; "
            "expected png16 (value / 256), png16:S or png8:S (value / S) as coding=..., as 'coding' in a "
            f"{HINTS} beside it, or in a CSV column 'coding'"
        )
    return settled


def _hints(folder: Path) -> dict[str, str]:
    path = folder / HINTS
    if not path.is_file():
        return {}
    hints = read_toml(path)
    for key, value in hints.items():
        if key not in HINT_KEYS:
            raise InputError(
                f"{path}: found the unknown key {key!r}, expected {', '.join(HINT_KEYS)}"
                f"{nearest(key, HINT_KEYS)}"
            )
        if not isinstance(value, str):
            raise InputError(f"{path}: {key} is {value!r}, expected a string")
    return hints


def _roles(folder: Path, hints: Mapping[str, str]) -> dict[str, Path]:
    """The files of a pair by role, as far as they are there."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    roles = {} if "left" in hints else _recognised(folder, files)
    for role in FILE_HINTS:
        if role not in hints:
            continue
        roles.pop(role, None)  # a hint is never passed over in silence
        if (folder / hints[role]).is_file():
            roles[role] = folder / hints[role]
        elif role == "mask" and "left" in roles:
            raise InputError(f"{folder}: found no {hints[role]}, which a {HINTS} names as its mask")
    return roles


def _recognised(folder: Path, files: list[Path]) -> dict[str, Path]:
    rows = [row for row in _conventions(files) if _pick(folder, files, (row[0],), IMAGES)]
    if len(rows) > 1:
        names = ", ".join(row[0] for row in rows)
        raise InputError(
            f"{folder}: found several left images ({names}), expected one pair a folder; "
            f"name left, right and disparity in a {HINTS}, or list the pairs in a CSV"
        )
    if not rows:
        return {}
    left, right, disparity = rows[0]
    roles = {
        "left": _pick(folder, files, (left,), IMAGES),
        "right": _pick(folder, files, (right,), IMAGES),
        "disparity": _pick(folder, files, disparity, DISPARITIES),
        "mask": _pick(folder, files, MASKS, (".png",)),
        "calibration": _pick(folder, files, ("calib",), (".txt",)),
    }
    return {role: path for role, path in roles.items() if path is not None}


def _conventions(files: Iterable[Path]) -> list[tuple[str, str, tuple[str, ...]]]:
    """The table of names, and those that end in ``_left``."""
    stems = sorted({f.stem.removesuffix("_left") for f in files if f.stem.endswith("_left")})
    truths = ("disp", "disparity", "disp_left", "disparity_left")
    # NAME_disp_left is ground truth, not the left image of a pair called NAME_disp.
    named = [
        (f"{s}_left", f"{s}_right", tuple(f"{s}_{truth}" for truth in truths))
        for s in stems
        if s.rpartition("_")[2] not in truths
    ]
    return [*CONVENTIONS, *named]


def _pick(folder: Path, files: list[Path], stems: Iterable[str], suffixes: tuple[str, ...]) -> Path | None:
    for stem in stems:
        match = [f for f in files if f.stem == stem and f.suffix.lower() in suffixes]
        if len(match) > 1:
            names = " and ".join(f.name for f in match)
            raise InputError(f"{folder}: found {names}, expected one of them; name it in a {HINTS}")
        if match:
            return match[0]
    return None
