"""YAML as other programs' configurations are written in it, refused where it only means to grow."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]  # PyYAML ships no types

from sfkit.errors import InputError

LARGEST = 2**20  # bytes of a file
MOST = 100_000  # values, those that aliases repeat counted each time


def read_yaml(path: Path, expected: str) -> dict[str, Any]:
    """The mapping in a YAML file: plain values, no objects.

    Args:
        path: the file.
        expected: the end of the sentence that refuses it.

    Raises:
        InputError: it cannot be read, is no YAML or no mapping, nested without end, or grows by its aliases.
    """
    try:
        with path.open("rb") as stream:
            # One byte more than is allowed tells that there is more.
            data = stream.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise InputError(f"{path}: is larger than {LARGEST} bytes: {expected}")
        content = yaml.safe_load(data.decode("utf-8"))
        values = _size(content, {})
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} cannot be read as YAML ({error}): {expected}") from error
    if values > MOST:
        raise InputError(f"{path}: holds {values} values once its aliases are written out: {expected}")
    if not isinstance(content, dict):
        raise InputError(f"{path} holds a {type(content).__name__}, expected a mapping: {expected}")
    return content


def _size(value: object, known: dict[int, int]) -> int:
    """How many values are in a value; one that lies in itself never ends, which is a RecursionError."""
    # Aliases share one object, which is measured once.
    if id(value) not in known:
        below: tuple[object, ...] = ()
        if isinstance(value, Mapping):
            below = (*value.keys(), *value.values())
        elif isinstance(value, list | set):
            below = tuple(value)
        known[id(value)] = 1 + sum(_size(entry, known) for entry in below)
    return known[id(value)]
