"""``--config FILE``: values of a command's options from a TOML file, under the names options have."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import typer

from sfkit.errors import InputError, unknown_name
from sfkit.files import home
from sfkit.outside import read_toml

_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false", Path: "a path"}


def read_config(path: Path, context: typer.Context, types: Mapping[str, Any]) -> dict[str, Any]:
    """The values a file gives the options of a command, by parameter.

    Args:
        path: of the TOML file.
        context: of the command.
        types: parameter -> annotation.

    Raises:
        InputError: the file cannot be read or is no TOML, or holds a name that is no option, a value of
            another type, or two values for one option; the sentence names file and key.
    """
    flags: dict[str, tuple[str, bool]] = {}
    for option in context.command.params:
        if option.name in types:
            flags |= {_name(flag): (option.name, False) for flag in option.opts}
            # As --no-report = true, beside report = false.
            flags |= {_name(flag): (option.name, True) for flag in option.secondary_opts}
    flags = {name: where for name, where in flags.items() if len(name) > 1}  # no -r for --root
    found: dict[str, Any] = {}
    for key, value in read_toml(path, "expected lines such as seed = 1").items():
        if key not in flags:
            raise InputError(f"{path}: {unknown_name('option', key, flags)}")
        parameter, negated = flags[key]
        if parameter in found:
            raise InputError(f"{path}: {key} is said twice, by two names of one option, expected one of them")
        made = _value(value, types[parameter], f"{path}: {key}")
        found[parameter] = not made if negated else made
    return found


def _name(flag: str) -> str:
    return flag.lstrip("-")


def _value(value: Any, annotation: Any, place: str) -> Any:
    """A value as the command line would have it; its type is the option's, strictly."""
    kind = _plain(annotation)
    if kind is str and isinstance(value, list):
        # Where the command line takes a,b a file may have a list.
        return ",".join(_value(entry, str, place) for entry in value)
    if get_origin(kind) in (list, tuple):
        inner = [entry for entry in get_args(kind) if entry is not Ellipsis]
        if not isinstance(value, list) or (get_origin(kind) is tuple and len(value) != len(inner)):
            many = len(inner) if get_origin(kind) is tuple else "any number of"
            raise InputError(f"{place}: found {value!r}, expected a list of {many} values")
        return [_value(entry, inner[0], place) for entry in value]
    # TOML tells 1 from 1.0; an option that wants a number takes both.
    accepted = {float: (float, int), Path: (str,)}.get(kind, (kind,))
    # true is a whole number to Python.
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise InputError(f"{place}: found {value!r}, expected {_WORDS[kind]}")
    return str(home(value)) if kind is Path else value


def _plain(annotation: Any) -> Any:
    """``Annotated[int | None, ...]`` -> ``int``."""
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) in (Union, UnionType):
        (annotation,) = (entry for entry in get_args(annotation) if entry is not type(None))
    # The command line refuses what is none of its words.
    return str if isinstance(annotation, type) and issubclass(annotation, Enum) else annotation
