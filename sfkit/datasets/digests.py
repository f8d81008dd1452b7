"""Fingerprints of files, remembered while a file stays as it was."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from sfkit.errors import InputError
from sfkit.files import Signature, signature


def file_digest(path: Path) -> str:
    """SHA-256 (hex) of a file's content; read again only where its :func:`~sfkit.files.signature` is new.

    Raises:
        InputError: there is no such file, or it cannot be read.
    """
    try:
        return _digest(Path(path), signature(Path(path)))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}), expected a file") from error


@lru_cache(maxsize=16384)
# The look is there for the cache's key: a file that was written to since is read again.
def _digest(path: Path, _looks: Signature) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
