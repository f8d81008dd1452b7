"""Where the manifests that ship lie, and how they are called: known before any of them is read."""

from __future__ import annotations

from pathlib import Path

from sfkit import files
from sfkit.errors import InputError


def manifest_folder() -> Path:
    """The folder of manifests: inside the package in a wheel, beside it in a checkout.

    Raises:
        InputError: neither is there.
    """
    folder = files.shipped("data_manifests", "data_manifests")
    if folder is None:
        raise InputError(
            f"{files.PACKAGE}: found no data_manifests folder in or beside it, install sfkit again"
        )
    return folder


def manifest_names() -> tuple[str, ...]:
    """The names of all manifests, sorted."""
    return tuple(sorted(path.stem for path in manifest_folder().glob("*.toml")))
