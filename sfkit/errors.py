"""Errors a user can act on: one sentence that says what was found, what was expected, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from enum import StrEnum
from typing import Any, TypeVar

Choice = TypeVar("Choice", bound=StrEnum)


class SfkitError(Exception):
    """Base of every error sfkit raises on purpose; the command line prints it without a traceback."""


class InputError(SfkitError, ValueError):
    """Something the caller gave is wrong: a file, a key, an argument. The command line exits with 2."""


class StoreError(SfkitError):
    """The evaluation store cannot be used as it is (damaged, not a store, on a network file system)."""


class DamagedStoreError(StoreError):
    """Part of an evaluation store is not what was written; :mod:`sfkit.evaluation.rescue` reads the rest."""


def nearest(name: str, allowed: Iterable[str]) -> str:
    """``"; did you mean 'x'?"`` for the closest allowed name, else the empty string."""
    match = difflib.get_close_matches(name, list(map(str, allowed)), n=1, cutoff=0.5)
    return f"; did you mean {match[0]!r}?" if match else ""


def unknown_name(kind: str, name: str, allowed: Iterable[str]) -> InputError:
    """The error for a name that is none of ``allowed``, with the nearest one suggested."""
    options = sorted(map(str, allowed))
    listed = ", ".join(options) if options else "none is known"
    return InputError(f"unknown {kind} {name!r}, expected one of: {listed}{nearest(name, options)}")


def ensure_known(kind: str, name: object, allowed: Collection[Any]) -> None:
    """Refuse a name that is none of ``allowed``.

    Raises:
        InputError: as :func:`unknown_name` says it.
    """
    if name not in allowed:
        raise unknown_name(kind, str(name), allowed)


def member_of(choices: type[Choice], kind: str, name: object) -> Choice:
    """The member of an enumeration that is called ``name``, or is it.

    Raises:
        InputError: as :func:`unknown_name` says it.
    """
    ensure_known(kind, name, tuple(choices))
    return choices(str(name))


class SfkitWarning(UserWarning):
    """Something works but is probably not what was meant; the sentence says why."""
