"""Where the manifests that ship lie, and how they are called: known before any of them is read."""

from __future__ import annotations

from pathlib import Path

from sfkit import files
from sfkit.errors import InputError, ensure_known

PAIRS, UNLABELLED = "pairs", "unlabelled"  # benchmarks of one's own, of which no manifest ships


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


def source_manifest_folder() -> Path:
    """The folder of the training sets' manifests."""
    return manifest_folder() / "training"


def source_manifest_names() -> tuple[str, ...]:
    """The names of all training sets with a manifest, sorted."""
    return tuple(sorted(path.stem for path in source_manifest_folder().glob("*.toml")))


def ensure_data_set(name: str, *others: str) -> None:
    """Refuse what is neither a manifest's name nor a benchmark of one's own.

    Raises:
        InputError: it is none of these, nor of ``others``.
    """
    ensure_known("data set", name, (*manifest_names(), PAIRS, UNLABELLED, *others))


def ensure_training_set(name: str, *others: str) -> None:
    """Refuse what is neither a training set's nor a benchmark's name, nor ``pairs``.

    Raises:
        InputError: it is none of these, nor of ``others``.
    """
    ensure_known("training set", name, (*source_manifest_names(), *manifest_names(), PAIRS, *others))
