"""Settings: frozen dataclasses whose fields say in one place what they are and what they may be.

A field made by :func:`setting` has a default, a sentence of help and a check. :func:`settle` runs the checks
of a record on construction, and the command line turns the fields into options.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields
from numbers import Integral, Real
from typing import Any

from sfkit.errors import InputError, ensure_known

_KEY = "sfkit"

Check = Callable[[str, Any], Any]
"""Takes a field's name and value, and returns the value as it is kept; raises InputError."""


@dataclass(frozen=True)
class Setting:
    """What a field says of itself.

    Attributes:
        help: a sentence for people.
        flags: how the command line calls it; ``--its-name`` where there are none.
        check: its check, None where the record has no rule for it alone.
    """

    help: str
    flags: tuple[str, ...] = ()
    check: Check | None = None


def setting(default: Any, *flags: str, help: str, check: Check | None = None) -> Any:
    """A field of a settings record; without a default (``...``) it has to be given."""
    default = MISSING if default is ... else default
    return field(default=default, metadata={_KEY: Setting(help, flags, check)})


def setting_of(entry: Field[Any]) -> Setting | None:
    """What a field says of itself; None for one that is no setting."""
    return entry.metadata.get(_KEY)


def settle(record: Any) -> None:
    """Check every field of a new record and keep its value in one type; None stays where it is the default.

    Raises:
        InputError: as the checks say.
    """
    for entry in fields(record):
        declared, value = setting_of(entry), getattr(record, entry.name)
        # None says that the method chooses, where the field allows it.
        if (
            declared is not None
            and declared.check is not None
            and not (value is None and entry.default is None)
        ):
            # A frozen record is still being made here.
            object.__setattr__(record, entry.name, declared.check(entry.name, value))


def require_whole(argument: str, value: object, least: int) -> int:
    """The value as an ``int``; refuses anything but a whole number of at least ``least``.

    Raises:
        InputError: naming the argument, what was found and what was expected.
    """
    # To Python True is a whole number; as a setting it is a mistake.
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < least:
        raise InputError(f"{argument}: found {value!r}, expected a whole number of at least {least}")
    return int(value)


def whole(least: int, most: int | None = None) -> Check:
    """The check of a setting that is a whole number of at least ``least``, and of at most ``most``."""

    def check(argument: str, value: Any) -> Any:
        number = require_whole(argument, value, least)
        if most is not None and number > most:
            raise InputError(f"{argument}: found {number}, expected a whole number of at most {most}")
        return number

    return check


def between(low: float, high: float = math.inf) -> Check:
    """The check of a setting in [low, high]."""

    def check(argument: str, value: Any) -> Any:
        require_between(argument, value, low, high)
        return float(value)

    return check


def positive(argument: str, value: Any) -> Any:
    """The check of a setting above 0."""
    require_positive(argument, value)
    return float(value)


def one_of(words: tuple[str, ...]) -> Check:
    """The check of a setting that is one of some words."""

    def check(argument: str, value: Any) -> Any:
        ensure_known(argument, value, words)
        return value

    return check


def require_between(argument: str, value: object, low: float, high: float = math.inf) -> None:
    """Refuse anything but a finite number in [low, high].

    Raises:
        InputError: naming the argument, what was found and what was expected.
    """
    if isinstance(value, Real):
        # Any kind of number, as NumPy's; NaN is in no range.
        number = float(value)
        if math.isfinite(number) and low <= number <= high:
            return
    wanted = f"of at least {low:g}" if high == math.inf else f"between {low:g} and {high:g}"
    raise InputError(f"{argument}: found {value!r}, expected a finite number {wanted}")


def require_positive(argument: str, value: object) -> None:
    """Refuse anything but a finite number above 0.

    Raises:
        InputError: naming the argument and what was found.
    """
    require_between(argument, value, 0.0)
    if value == 0:
        raise InputError(f"{argument}: found {value!r}, expected a finite number above 0")
