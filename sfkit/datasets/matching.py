"""Which left image belongs to which right one: that of its name, else that of its number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from sfkit.errors import InputError

Numbers = tuple[int, ...]
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".webp")


def match_pairs(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Two images, or the images of two folders matched by name (by number where no name is in both).

    Raises:
        InputError: a path is missing, a file meets a folder, both are one, the folders hold different
            numbers, some names are in both folders and some are not, or numbers differ.
    """
    for path in (left, right):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder, expected an image or a folder of images")
    ensure_two(left, right)
    if left.is_file() and right.is_file():
        return [(left, right)]
    if left.is_file() or right.is_file():
        raise InputError(f"{left} and {right}: found a file and a folder, expected two of one kind")
    lefts, rights = (_images(folder) for folder in (left, right))
    if len(lefts) != len(rights) or not lefts:
        raise InputError(
            f"{left} and {right}: found {len(lefts)} and {len(rights)} images, expected as many left as right"
        )
    by_name = {path.name: path for path in rights}
    alone = [path for path in lefts if path.name not in by_name]
    # Two cameras may name frames apart; then their numbers tell which belong together.
    if len(alone) == len(lefts):
        return match_by_number(lefts, rights)
    if alone:
        raise InputError(
            f"{alone[0]}: found no image of that name in {right}, expected all names in both folders, or none"
        )
    return [(path, by_name[path.name]) for path in lefts]


def _images(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)


def match_by_number(lefts: Sequence[Path], rights: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Pairs of images whose names have the same numbers: ``left2`` and ``right002``.

    A number that all names of a side share, such as a camera's, is not compared. One image a side is a pair
    whatever its name.

    Raises:
        InputError: names without numbers, one number twice on a side, or a number on one side only.
    """
    if len(lefts) == len(rights) == 1:
        return [(lefts[0], rights[0])]
    ours, theirs = _numbered(lefts), _numbered(rights)
    for one, other, images in ((ours, theirs, rights), (theirs, ours, lefts)):
        for number, path in one.items():
            if number not in other:
                shown = "-".join(map(str, number))
                raise InputError(
                    f"{path}: found no image of number {shown} among those beside {images[0]}, expected a "
                    "name or a number in common: were frames dropped? Rename them, or list the pairs in a CSV"
                )
    return [(path, theirs[number]) for number, path in sorted(ours.items())]


def ensure_two(left: Path, right: Path) -> None:
    """Refuse one place for both sides: an image paired with itself shows no disparity.

    Raises:
        InputError: both are the same file or folder.
    """
    if left.exists() and right.exists() and left.samefile(right):
        raise InputError(f"{left} and {right}: are one and the same, expected the left and the right image")


def _numbered(paths: Sequence[Path]) -> dict[Numbers, Path]:
    found = [tuple(map(int, re.findall(r"\d+", path.stem))) for path in paths]
    length = len(found[0])
    for path, numbers in zip(paths, found, strict=True):
        if not numbers or len(numbers) != length:
            raise InputError(
                f"{path}: has no name in common with an image of the other side and its name has "
                f"{len(numbers)} numbers, expected as many as {paths[0].name}, at least one, to match by: "
                "rename them, or list the pairs in a CSV"
            )
    # What is the same in all names, such as a camera's number, tells nothing.
    told = [n for n in range(length) if len({numbers[n] for numbers in found}) > 1] or [*range(length)]
    by_number: dict[Numbers, Path] = {}
    for path, numbers in zip(paths, found, strict=True):
        other = by_number.setdefault(tuple(numbers[n] for n in told), path)
        if other is not path:
            raise InputError(f"{path} and {other}: have one number, expected one image of each: rename one")
    return by_number
