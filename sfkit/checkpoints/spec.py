"""``pool.toml``: which files make a pool, of which architecture, under which licences.

::

    name = "garage"
    architecture = "anynet"             # or "my_net:MyNet", a class in my_net.py beside this file
    module = "nets/mine.py"             # optional; the Python file that registers it, which is run
    root = "${CHECKPOINTS}/garage"      # optional; the folder of pool.toml otherwise

    [options]                           # optional; the architecture's options
    ranges = [12, 3, 3]

    [base]
    file = "base_sceneflow.tar"
    licence = "MIT"

    [sources.kitti2012]
    file = "ft_kitti2012.tar"
    licence = "MIT; trained on KITTI (CC BY-NC-SA 3.0)"

    container = "ema"                   # optional, here or at the top: the entry of the file that holds the
    prefix = "model."                   # weights, and what stands before their keys; recognised otherwise

    [blocks]                            # optional; replaces the architecture's own partition
    backbone = ["feature_extraction.*"]
    head = ["volume_postprocess.*"]

In place of the table ``blocks = "modules"`` or ``"disagreement:6"`` at the top makes a partition of four, or
six, blocks from the network itself.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sfkit.checkpoints.layouts import Wrapping
from sfkit.errors import InputError
from sfkit.files import trouble
from sfkit.outside import read_toml, table

_WRAPPING = ("container", "prefix")
_KEYS = ("name", "architecture", "module", "root", "options", "base", "sources", "blocks", *_WRAPPING)
_MEMBER_KEYS = ("file", "licence", "note", *_WRAPPING)
ROWS = ("base", "uniform")
"""What tables and merged files call other networks than sources."""
SOURCE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class Member:
    """One checkpoint a pool names: the base or a source."""

    name: str
    path: Path
    licence: str = ""
    note: str = ""
    wrapping: Wrapping = field(default_factory=Wrapping)


@dataclass(frozen=True)
class PoolSpec:
    """A pool as its ``pool.toml`` describes it; no checkpoint has been opened yet.

    ``blocks`` names the blocks' keys, ``partition`` how to find them; at most one of the two is given.
    ``module`` is the user's file that registers the architecture.
    """

    name: str
    architecture: str
    base: Member
    sources: tuple[Member, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    blocks: Mapping[str, tuple[str, ...]] | None = None
    path: Path | None = None
    partition: str | None = None
    module: Path | None = None

    def __post_init__(self) -> None:
        for source in self.sources:
            if source.name in ROWS or "+" in source.name:
                raise InputError(
                    f"{self.path or f'pool {self.name!r}'}: source name {source.name!r}, expected another: "
                    "tables call the base and merges so (base, uniform, a+b)"
                )


def read_pool_spec(path: str | Path) -> PoolSpec:
    """Read and check a ``pool.toml``.

    Raises:
        InputError: the file is missing or no TOML, a key is unknown, missing or of the wrong type, a
            path leaves its root, or a source is named twice.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "pool.toml"
    if why := trouble(path):
        raise InputError(f"{path}: {why}, expected a pool.toml that names a base and its sources")
    return _spec(read_toml(path, "expected a pool description"), path)


def _spec(values: dict[str, Any], path: Path) -> PoolSpec:
    values = table(values, str(path), _KEYS)
    root = _root(values.get("root", "."), path)
    common = _wrapping(values, path, "", Wrapping())
    sources = _table(values, "sources", path)
    if not sources:
        raise InputError(f"{path}: names no sources, expected one [sources.NAME] table for each")
    members = tuple(
        _member(name, entry, root, path, f"sources.{name}", common) for name, entry in sources.items()
    )
    return PoolSpec(
        name=_text(values, "name", path),
        architecture=_text(values, "architecture", path),
        base=_member("base", _table(values, "base", path), root, path, "base", common),
        sources=members,
        options=dict(_table(values, "options", path, required=False)),
        blocks=None if isinstance(values.get("blocks"), str) else _blocks(values, path),
        path=path,
        partition=_text(values, "blocks", path) if isinstance(values.get("blocks"), str) else None,
        module=path.parent.resolve() / _text(values, "module", path) if "module" in values else None,
    )


def _root(text: object, path: Path) -> Path:
    if not isinstance(text, str):
        raise InputError(f"{path}: root is {text!r}, expected a folder as text")

    def variable(match: re.Match[str]) -> str:
        if match.group(1) not in os.environ:
            raise InputError(
                f"{path}: root names the environment variable {match.group(1)}, which is not set"
            )
        return os.environ[match.group(1)]

    root = path.parent / re.sub(r"\$\{(\w+)\}", variable, text)
    if not root.is_dir():
        raise InputError(f"{path}: root {root} is no folder, expected the folder of the checkpoints")
    return root.resolve()


def _member(name: str, entry: object, root: Path, path: Path, where: str, common: Wrapping) -> Member:
    if not SOURCE_NAME.fullmatch(name):
        raise InputError(f"{path}: source name {name!r}, expected letters, digits and _ . - only")
    if not isinstance(entry, dict):
        raise InputError(f"{path}: {where} is {entry!r}, expected a table with file and licence")
    entry = table(entry, f"[{where}] in {path}", _MEMBER_KEYS)
    text = _text(entry, "file", path, where)
    if "\0" in text:
        raise InputError(f"{path}: {where}.file is {text!r}, expected a path")
    file = Path(os.path.normpath(root / text))
    if not file.is_relative_to(root):  # links there, such as a hub's cache is made of, lead where they lead
        raise InputError(
            f"{path}: {where}.file {entry['file']!r} leaves the root {root}, expected a path under it"
        )
    optional = {key: _text(entry, key, path, where) for key in ("licence", "note") if key in entry}
    return Member(name, file, **optional, wrapping=_wrapping(entry, path, where, common))


def _wrapping(values: Mapping[str, Any], path: Path, where: str, common: Wrapping) -> Wrapping:
    given = {key: _text(values, key, path, where) for key in _WRAPPING if key in values}
    return replace(common, **given)


def _blocks(values: Mapping[str, Any], path: Path) -> dict[str, tuple[str, ...]] | None:
    table = _table(values, "blocks", path, required=False)
    for name, patterns in table.items():
        if not isinstance(patterns, list) or not patterns or not all(isinstance(p, str) for p in patterns):
            raise InputError(f"{path}: blocks.{name} is {patterns!r}, expected a list of key patterns")
    return {name: tuple(patterns) for name, patterns in table.items()} or None


def _text(values: Mapping[str, Any], key: str, path: Path, where: str = "") -> str:
    name = f"{where}.{key}" if where else key
    if key not in values:
        raise InputError(f"{path}: the key {name} is missing, expected text")
    if not isinstance(values[key], str) or not values[key]:
        raise InputError(f"{path}: {name} is {values[key]!r}, expected text")
    return str(values[key])


def _table(values: Mapping[str, Any], key: str, path: Path, *, required: bool = True) -> dict[str, Any]:
    if key not in values and required:
        raise InputError(f"{path}: the table [{key}] is missing")
    table = values.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{path}: {key} is {table!r}, expected a table")
    return table
