"""Manifests of training sets: where their files lie, how they are coded, whose they are, what is held out."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from sfkit.datasets.manifests import check_name, made, pop_layouts
from sfkit.datasets.shipped import source_manifest_folder, source_manifest_names
from sfkit.errors import InputError, ensure_known, unknown_name
from sfkit.outside import read_toml, table


@dataclass(frozen=True)
class SourceLayout:
    """How a left image's path gives the others.

    Attributes:
        left: regular expression of the path that finds a pair, under the root or a folder in it: the left
            image's, unless ``image`` says that one; its named groups fill the others.
        right: the right image, with ``{group}``.
        disparity: the ground truth, with ``{group}``.
        coding: see :mod:`sfkit.datasets.source_codings`, with ``{group}`` and ``{constant}``.
        sequence: the sequence a pair belongs to, with ``{group}``: what is held out whole.
        invalid: masks whose non-zero pixels are unknown.
        image: the left image, with ``{group}``, where several pairs share it.
    """

    left: re.Pattern[str]
    right: str
    disparity: str
    coding: str
    sequence: str
    invalid: tuple[str, ...] = ()
    image: str = ""


@dataclass(frozen=True)
class SourceManifest:
    """A public training set.

    Attributes:
        name: what :func:`~sfkit.datasets.training_sets.open_training_set` calls it.
        title: its name in prose.
        home: where it is published.
        get: how to download and unpack it.
        licence: the terms of the data.
        citation: what to cite.
        pairs: how many it has to train on.
        camera: focal length and baseline, or why they are not needed.
        unknown: what its stored values say about unknown pixels and the sky, and what is made of them.
        layouts: the layouts in use.
        held_out: regular expressions of sequences that are held out.
        hold_every: beside them every so many-th sequence, by a digest of its name; 0 for none.
        width: the image width its constants are for; 0 where none depends on it.
        constant: how ``{constant}`` is found (:mod:`sfkit.datasets.source_cameras`); empty where it is not
        used.
        unused: a file of the root that lists pairs the authors withdrew.
    """

    name: str
    title: str
    home: str
    get: str
    licence: str
    citation: str
    pairs: int
    camera: str
    unknown: str
    layouts: tuple[SourceLayout, ...]
    held_out: tuple[str, ...] = ()
    hold_every: int = 0
    width: int = 0
    constant: str = ""
    unused: str = ""

    def holds_out(self, sequence: str) -> bool:
        """Whether a sequence is kept from training."""
        if any(re.fullmatch(pattern, sequence) for pattern in self.held_out):
            return True
        # Python's own hash of a text differs from process to process.
        return bool(self.hold_every) and zlib.crc32(sequence.encode()) % self.hold_every == 0


def load_source_manifest(name: str) -> SourceManifest:
    """The manifest of the training set ``name``.

    Raises:
        InputError: no such manifest, or its file is not valid.
    """
    if name not in source_manifest_names():
        raise unknown_name("training set", name, (*source_manifest_names(), "pairs"))
    return read_source_manifest(source_manifest_folder() / f"{name}.toml")


def read_source_manifest(path: Path) -> SourceManifest:
    """Read and check a manifest file.

    Raises:
        InputError: not TOML, or a key is unknown, missing or makes no sense; it is named.
    """
    data = read_toml(path)
    layouts = pop_layouts(path, data)
    if "held_out" in data:
        data["held_out"] = tuple(data["held_out"])
    data["layouts"] = tuple(_layout(path, dict(layout)) for layout in layouts)
    manifest: SourceManifest = _record(path, SourceManifest, data)
    check_name(path, manifest.name)
    return manifest


def _layout(path: Path, entry: dict[str, Any]) -> SourceLayout:
    try:
        entry["left"] = re.compile(entry.get("left", ""))
    except re.error as error:
        raise InputError(f"{path}: left is {entry['left']!r}, no regular expression ({error})") from error
    if "invalid" in entry:
        entry["invalid"] = tuple(entry["invalid"])
    layout: SourceLayout = _record(path, SourceLayout, entry)
    groups = {**dict.fromkeys(layout.left.groupindex, ""), "constant": ""}
    for text in (
        *(layout.right, layout.disparity, layout.coding, layout.sequence, layout.image),
        *layout.invalid,
    ):
        for name in re.findall(r"{(\w+)}", text):
            ensure_known(f"group in {text!r} of {path}", name, groups)
    return layout


def _record(path: Path, cls: type[Any], data: Mapping[str, Any]) -> Any:
    return made(path, cls, table(data, str(path), [f.name for f in fields(cls)]))
