"""What kind of file a merged network becomes, and whether it can be written where it is to be."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path

from sfkit.checkpoints.headers import SAFETENSORS, WRITTEN_SUFFIXES
from sfkit.errors import InputError, member_of
from sfkit.files import ensure_writable

DTYPE_NAMES = ("float32", "float16", "bfloat16")
"""Data types that a merged network may be written in, where somebody chooses one."""


class FileForm(StrEnum):
    """What kind of file a merged network becomes."""

    SAFETENSORS = "safetensors"
    ORIGINAL = "original"  # a torch file in the base checkpoint's layout


def check_target(path: str | Path, form: FileForm | str, *, overwrite: bool) -> Path:
    """Refuse an output path before any work is done for it.

    Raises:
        InputError: as :func:`sfkit.checkpoints.writing.write_checkpoint` says.
    """
    form = member_of(FileForm, "form", form)
    endings = (SAFETENSORS,) if form is FileForm.SAFETENSORS else WRITTEN_SUFFIXES
    other = next((f.value for f in FileForm if f is not form), "")
    advice = f"name it so, or ask for form={other!r}"
    return check_file(Path(path), f"form {form.value!r}", endings, advice, overwrite=overwrite)


def check_file(
    path: Path, kind: str, endings: Sequence[str], advice: str = "name it so", *, overwrite: bool
) -> Path:
    """Refuse a file to write whose name, kind or place does not do, before any work is done for it.

    Raises:
        InputError: its ending is none of its kind's, it is a folder, has a name that is no UTF-8, exists and
            may not be replaced, or its folder cannot be made or written to.
    """
    if path.suffix not in endings:
        raise InputError(f"{path}: a file of {kind} ends in {' or '.join(endings)}: {advice}")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected the name of a file to write")
    # As Python spells bytes that are no UTF-8.
    if any("\ud800" <= letter <= "\udfff" for letter in str(path)):
        raise InputError(f"{path}: is no UTF-8, expected a name that safetensors and torch can write")
    if path.exists() and not overwrite:
        raise InputError(f"{path}: the file exists, give another name or allow overwriting (--force)")
    ensure_writable(path.parent, path)
    return path


def ensure_room(path: Path, size: int) -> None:
    """Refuse a place whose disk has no room for a file.

    Args:
        path: the file to be written; its folder need not exist.
        size: of the file in bytes, about.

    Raises:
        InputError: less is free there.
    """
    # Its folder may be yet to come: what exists above lies on the same disk.
    place = next(f for f in path.absolute().parents if f.exists())
    free = shutil.disk_usage(place).free
    if free < size:
        raise InputError(
            f"{path}: {free / 2**20:.0f} MiB are free there, expected {size / 2**20:.0f} MiB for a network: "
            "make room, or name a place on another disk"
        )
