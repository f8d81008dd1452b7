"""Outside data: texts from files, read strictly. JSON and TOML enter here, and nothing of them is guessed.

UTF-8 with or without a byte order mark, at most ``DEPTH`` tables in one another, numbers of at most
``DIGITS`` characters, no key twice, no JSON value that is infinite or NaN. Whatever is wrong is an
:class:`~sfkit.errors.InputError` that names the place.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from sfkit.errors import InputError, ensure_known
from sfkit.files import trouble

Value = TypeVar("Value")
DEPTH = 64
DIGITS = 400
LARGEST = 256 * 2**20  # bytes
_LONG_NUMBER = re.compile(rf"[0-9_]{{{DIGITS + 1}}}")


def toml_value(value: object) -> str:
    """A value as TOML writes it: strings, numbers, truth values and lists of them are as in JSON.

    Raises:
        UnicodeEncodeError: a string is no text (:func:`is_text`), which neither holds.
    """
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_value(entry)}" for key, entry in value.items()) + " }"
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # which JSON leaves as it is
    text.encode()
    return text


def is_text(text: str) -> bool:
    """Whether UTF-8 can say it: names of files need not."""
    return not any("\ud800" <= character <= "\udfff" for character in text)


def read_toml(path: Path, expected: str = "correct the file") -> dict[str, Any]:
    """A TOML file's content.

    Args:
        path: the file.
        expected: the end of the sentence where it is no TOML.

    Raises:
        InputError: the file cannot be read, or is not TOML.
    """
    try:
        text = read_text(path)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not TOML (no UTF-8: {error.reason}), {expected}") from error
    # Unlike json, tomllib has no hook for whole numbers.
    if _LONG_NUMBER.search(text):
        raise InputError(f"{path}: is not TOML (a number of more than {DIGITS} digits), {expected}")
    try:
        return _shallow(tomllib.loads(text), str(path))  # type: ignore[no-any-return]
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not TOML ({_reason(error)}), {expected}") from error


def read_json(path: Path, expected: str = "correct the file") -> Any:
    """A JSON file's content; see :func:`parse_json`.

    Raises:
        InputError: the file cannot be read, or is not JSON.
    """
    try:
        return parse_json(read_text(path), str(path), expected)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not JSON (no UTF-8: {error.reason}), {expected}") from error


def read_text(path: Path) -> str:
    """A file's text, without its byte order mark.

    Raises:
        InputError: the file cannot be read, or is too large.
        UnicodeDecodeError: it is no UTF-8.
    """
    if why := trouble(path):  # a pipe, say, which would wait for ever
        raise InputError(f"{path}: cannot be read ({why}), expected a file")
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: is {path.stat().st_size} bytes long, expected at most {LARGEST}")
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}), expected a file") from error


def once(where: str, entries: Iterable[tuple[str, Value]]) -> dict[str, Value]:
    """Name -> value of entries that name each one once: the last of two would win without a word.

    Raises:
        InputError: one is named twice; ``where`` begins the sentence.
    """
    found: dict[str, Value] = {}
    for name, value in entries:
        if name in found:
            raise InputError(f"{where}: found {name!r} twice, expected it once")
        found[name] = value
    return found


def parse_json(text: str | bytes, where: str, expected: str = "correct it") -> Any:
    """A JSON text's value.

    Args:
        text: UTF-8 where it is bytes.
        where: begins the sentence of an error.
        expected: ends it.

    Raises:
        InputError: not JSON, a key twice in one object, too deep, or a number that is none.
    """

    def whole(digits: str) -> int:
        # Python reads thousands of digits in quadratic time, and refuses more than 4,300 in words of its own.
        if len(digits) > DIGITS:
            raise InputError(f"{where}: not JSON (a number of {len(digits)} digits), {expected}")
        return int(digits)

    def number(digits: str) -> float:
        value = float(digits)
        if len(digits) > DIGITS or not math.isfinite(value):
            raise InputError(f"{where}: not JSON (the number {digits[:20]}), {expected}")
        return value

    def constant(word: str) -> NoReturn:
        raise InputError(f"{where}: not JSON (found {word}), {expected}")

    def pairs(entries: list[tuple[str, Any]]) -> dict[str, Any]:
        # The last of two would win without a word.
        held = dict(entries)
        if len(held) < len(entries):
            keys = [key for key, _ in entries]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"{where}: has the key {twice!r} twice in one object, {expected}")
        return held

    # Windows begins files with a mark that json refuses.
    try:
        plain = text.decode("utf-8-sig") if isinstance(text, bytes) else text.removeprefix("\ufeff")
        value = json.loads(
            plain, parse_int=whole, parse_float=number, parse_constant=constant, object_pairs_hook=pairs
        )
        return _shallow(value, where)
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{where}: not JSON ({_reason(error)}), {expected}") from error


def number(value: object, where: str, *, least: float = -math.inf) -> float:
    """A finite number of at least ``least``, which a truth value or a text is not.

    Raises:
        InputError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where} is {value!r}, expected a number")
    # By its own comparison: a whole number beyond a float's range cannot be made one.
    if not abs(value) <= 1e308 or not float(value) >= least:
        bound = "" if least == -math.inf else f" of at least {least:g}"
        raise InputError(f"{where} is {value!r}, expected a finite number{bound}")
    return float(value)


def text(value: object, where: str) -> str:
    """A text.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, str):
        raise InputError(f"{where} is {value!r}, expected a text")
    return value


def table(value: object, where: str, keys: Collection[str] | None = None) -> dict[str, Any]:
    """A table (a JSON object) with no other keys than ``keys``.

    Raises:
        InputError: it is none, or has another key, which is named.
    """
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: found {_shown(value)}, expected a table")
    for key in value if keys is not None else ():
        ensure_known(f"key of {where}", key, keys or ())
    return dict(value)


def _shallow(value: Any, where: str) -> Any:
    """The value, unless more than ``DEPTH`` tables or lists lie in one another."""
    level, depth = [value], 0
    # Level by level: what is nested deeper than Python's stack is measured too.
    while level:
        level = [inner for held in level for inner in _inside(held)]
        depth += 1
        if depth > DEPTH and level:
            raise InputError(f"{where}: nests more than {DEPTH} tables or lists, expected what sfkit writes")
    return value


def _inside(value: Any) -> Collection[Any]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()


def _reason(error: Exception) -> str:
    return "tables or lists without end" if isinstance(error, RecursionError) else str(error)


def _shown(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
