"""Checks of arguments that every search makes before its first evaluation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

from sfkit.errors import InputError, ensure_known, unknown_name
from sfkit.settings import Check

METHODS = ("paper", "bayesian")
"""Ways to search: StereoFactory's two algorithms, or a model of the score in both stages."""
LARGEST_POPULATION = 100_000
"""Candidates that are held at the same time; what is far above is a slip, and would fill the memory."""


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


def distinct_names(argument: str, values: Iterable[str]) -> tuple[str, ...]:
    """The names as a tuple, in the order given.

    Raises:
        InputError: one string was given for a list, an entry is no string, or a name comes twice.
    """
    if isinstance(values, str):
        raise InputError(
            f"{argument}: found the text {values!r}, expected a list of names: write [{values!r}]"
        )
    names = tuple(values)
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{argument}: found the entry {name!r}, expected names")
        if names.count(name) > 1:
            raise InputError(f"{argument}: found {name!r} more than once, expected each name once")
    return names


def require_known(argument: str, names: Iterable[str], allowed: Iterable[str], kind: str) -> None:
    """Refuse names outside ``allowed``; the nearest allowed name is suggested.

    Args:
        argument: what the caller passed the names as.
        names: what the caller passed.
        allowed: every name there is.
        kind: what the names stand for, "source" or "block".

    Raises:
        InputError: naming the argument, the first unknown name and the allowed ones.
    """
    known = tuple(allowed)
    for name in names:
        if name not in known:
            raise InputError(f"{argument}: {unknown_name(kind, name, known)}")


def check_rank(rank: int | None, tied: bool) -> None:
    """Refuse a rank of routing that is tied, or that is no whole number of at least 1.

    Raises:
        InputError: what was found.
    """
    if rank is None:
        return
    require_whole("rank", rank, 1)
    if tied:
        raise InputError(f"rank: found {rank} and tied=True, expected tied=False: tied routing has one row")


def check_gamma(argument: str, gamma: tuple[float, float]) -> tuple[float, float]:
    """Bounds of the module scales, which are [low, high] with 0 <= low < 1 < high and midpoint 1.

    Raises:
        InputError: what was found, and why the midpoint matters.
    """
    if not isinstance(gamma, tuple | list) or len(gamma) != 2:
        raise InputError(f"{argument}: found {gamma!r}, expected two numbers such as (0.25, 1.75)")
    low, high = gamma
    require_between(argument, low, 0.0)
    require_between(argument, high, 0.0)
    if not low < 1.0 < high or abs((low + high) / 2.0 - 1.0) > 1e-9:
        raise InputError(
            f"{argument}: found [{low:g}, {high:g}], expected bounds around 1 with 1 in the middle, such as "
            "[0.25, 1.75], so that x = 0 is the equal-weight merge"
        )
    return float(low), float(high)
