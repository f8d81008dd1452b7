"""Manifests: what a public data set looks like on disk, and its terms; one TOML file each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from sfkit.datasets.formats import Coding
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import MaskCoding
from sfkit.datasets.protocols import rule
from sfkit.datasets.shipped import ensure_data_set, manifest_folder
from sfkit.errors import InputError, member_of, nearest, unknown_name
from sfkit.outside import read_toml

ID, RESOLUTION = "{id}", "{resolution}"
MOST = 1_000_000
# str.format reaches into objects: a manifest may ask it for a padded number and nothing else.
_COUNTED = re.compile(r"[^{}]*\{0?(?::0?\d?\d?d?)?\}[^{}]*")


@dataclass(frozen=True)
class PairLayout:
    """Where the files of a pair lie under the root; ``{id}`` and ``{resolution}`` stand for names.

    Attributes:
        left: pattern of the left image; its ``{id}`` is what finds the pairs.
        right: pattern of the right image.
        disparity: pattern of the ground truth.
        coding: how the ground truth is coded, see :mod:`sfkit.datasets.formats`.
        id: regular expression that an id must match.
        mask: pattern of the occlusion mask; a pair may lack it.
        mask_coding: how the mask says what is visible.
        calibration: pattern of the calibration file; a pair may lack it.
        note: what to tell the reader where this layout is used.
    """

    left: str
    right: str
    disparity: str
    coding: str
    id: str = r"[^/]+"
    mask: str | None = None
    mask_coding: MaskCoding = MaskCoding.EQUALS_255
    calibration: str | None = None
    note: str = ""

    def patterns(self) -> dict[str, str]:
        """The patterns by role, those that are set."""
        roles = ("left", "right", "disparity", "mask", "calibration")
        return {role: value for role in roles if (value := getattr(self, role)) is not None}


@dataclass(frozen=True)
class Manifest:
    """A public data set.

    Attributes:
        name: what :func:`sfkit.datasets.benchmark.open_benchmark` is called with.
        title: its name in prose.
        family: which of a protocol's rules applies.
        home: where it is published.
        get: one sentence on how to download and unpack it.
        licence: its terms.
        citation: what to cite.
        metric: what the data set itself reports.
        ids: the names of all its pairs.
        layouts: the folder layouts in use, the preferred one first.
        places: sub-folders of the root in which a layout may begin, the root itself first.
        resolutions: the resolutions it comes in, the default first; empty where there is one only.
    """

    name: str
    title: str
    family: str
    home: str
    get: str
    licence: str
    citation: str
    metric: str
    ids: tuple[str, ...]
    layouts: tuple[PairLayout, ...]
    places: tuple[str, ...] = ("",)
    resolutions: tuple[str, ...] = ()

    def resolution(self, wanted: str | None, allowed: tuple[str, ...] = ()) -> str | None:
        """The resolution to open: the one wanted, else the first that is ``allowed`` (all, where empty).

        Raises:
            InputError: the data set does not come in that resolution.
        """
        if wanted is not None and wanted not in self.resolutions:
            if not self.resolutions:
                raise InputError(
                    f"{self.name}: found resolution={wanted!r}, it comes in one only; leave it out"
                )
            raise unknown_name(f"resolution of {self.name}", wanted, self.resolutions)
        fitting = [r for r in self.resolutions if not allowed or r in allowed]
        return wanted if wanted is not None or not fitting else fitting[0]


def load_manifest(name: str) -> Manifest:
    """The manifest called ``name``.

    Raises:
        InputError: no such manifest, or its file is not valid.
    """
    ensure_data_set(name)
    return read_manifest(manifest_folder() / f"{name}.toml")


def read_manifest(path: Path) -> Manifest:
    """Read and check a manifest file.

    Raises:
        InputError: not TOML, or a key is unknown, missing or has a value that makes no sense; it is named.
    """
    data = read_toml(path)
    layouts = pop_layouts(path, data)
    ids = _ids(path, data.pop("ids", None))
    tuples = {key: _texts(path, key, data.pop(key)) for key in ("places", "resolutions") if key in data}
    known: dict[str, Any] = {"ids": ids, "layouts": tuple(_layout(path, entry) for entry in layouts)}
    manifest: Manifest = _record(path, Manifest, data, known | tuples)
    check_name(path, manifest.name)
    # Asked for what it refuses: an unknown family, here and not at the first pair.
    rule("all-valid", manifest.family)
    Metric.parse(manifest.metric)
    for place in manifest.places:
        _relative(path, "places", place)
    sized = any(RESOLUTION in p for layout in manifest.layouts for p in layout.patterns().values())
    # A resolution without a place in the patterns would open the same files under two names.
    if sized != bool(manifest.resolutions):
        raise InputError(f"{path}: expected both {RESOLUTION} in the layouts and 'resolutions', or neither")
    return manifest


def pop_layouts(path: Path, data: dict[str, Any]) -> list[Any]:
    """Take the [[layout]] tables out of a manifest's content; there is at least one."""
    layouts = data.pop("layout", None)
    if not isinstance(layouts, list) or not layouts:
        raise InputError(f"{path}: found no [[layout]], expected at least one")
    return layouts


def check_name(path: Path, name: str) -> None:
    """Refuse a manifest that names another data set than its file does."""
    if name != Path(path).stem:
        raise InputError(f"{path}: found the name {name!r}, expected that of the file")


def _layout(path: Path, entry: Any) -> PairLayout:
    if not isinstance(entry, dict):
        raise InputError(f"{path}: found the layout {entry!r}, expected a table [[layout]]")
    known: dict[str, Any] = {}
    if "mask_coding" in entry:
        known["mask_coding"] = member_of(MaskCoding, f"mask_coding in {path}", entry.pop("mask_coding"))
    layout: PairLayout = _record(path, PairLayout, entry, known)
    Coding.parse(layout.coding)
    for role, pattern in layout.patterns().items():
        _relative(path, role, pattern)
        if ID not in pattern:
            raise InputError(f"{path}: {role} is {pattern!r}, expected a pattern with {ID}")
    if sum(part.count(ID) for part in PurePosixPath(layout.left).parts) != 1:
        raise InputError(f"{path}: left is {layout.left!r}, expected {ID} exactly once")
    try:
        re.compile(layout.id)
    except re.error as error:
        raise InputError(f"{path}: id is {layout.id!r}, no regular expression ({error})") from error
    return layout


def _record(path: Path, cls: type[Any], data: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    """Build a record from string entries, refusing unknown and missing keys by name."""
    allowed = {f.name for f in fields(cls)}
    for key, value in data.items():
        if key not in allowed:
            raise InputError(f"{path}: found the unknown key {key!r}{nearest(key, allowed)}")
        if not isinstance(value, str):
            raise InputError(f"{path}: {key} is {value!r}, expected a string")
    return made(path, cls, {**data, **known})


def made(path: Path, cls: type[Any], values: Mapping[str, Any]) -> Any:
    """A record of a manifest's values; a key that is missing is named."""
    try:
        return cls(**values)
    except TypeError as error:
        raise InputError(f"{path}: {str(error).partition('__() ')[2]}, add the key") from error


def _ids(path: Path, given: Any) -> tuple[str, ...]:
    """The ids as listed, or counted: ``{format = "{:06d}_10", count = 194}``."""
    if isinstance(given, dict) and set(given) == {"format", "count"}:
        form, count = given["format"], given["count"]
        # To Python True is a whole number.
        counted = type(count) is int and count in range(1, MOST + 1)
        if not (isinstance(form, str) and _COUNTED.fullmatch(form)) or not counted:
            raise InputError(
                f"{path}: ids is {given!r}, expected a format such as '{{:06d}}_10' and a count up to {MOST}"
            )
        given = [form.format(number) for number in range(count)]
    if not isinstance(given, list) or not given or len(set(map(str, given))) != len(given):
        raise InputError(f"{path}: ids is {given!r}, expected a list of names or a format and a count")
    return tuple(map(str, given))


def _texts(path: Path, key: str, given: Any) -> tuple[str, ...]:
    if not isinstance(given, list) or not all(isinstance(entry, str) for entry in given):
        raise InputError(f"{path}: {key} is {given!r}, expected a list of texts")
    return tuple(given)


def _relative(path: Path, key: str, pattern: str) -> None:
    pure = PurePosixPath(pattern)
    if pure.is_absolute() or ".." in pure.parts or "\\" in pattern:
        raise InputError(f"{path}: {key} is {pattern!r}, expected a path under the root of the data set")
