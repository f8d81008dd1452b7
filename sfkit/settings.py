"""Settings: frozen dataclasses whose fields say in one place what they are and what they may be.

A field made by :func:`setting` has a default, a sentence of help and a check. :func:`settle` runs the checks
of a record on construction, and the command line turns the fields into options.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any

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
        if (
            declared is not None
            and declared.check is not None
            and not (value is None and entry.default is None)
        ):
            # A frozen record is still being made here.
            object.__setattr__(record, entry.name, declared.check(entry.name, value))
