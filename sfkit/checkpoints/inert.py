"""Torch files with foreign objects beside the weights, read without running a line of those objects' code.

Training scripts save their arguments, configuration and schedules into the checkpoint. ``torch.load`` with
``weights_only=True`` refuses such a file whole. Here the same reader is told that every class or function it
does not know is a :class:`Placeholder`, an empty class of that name: tensors come out as they are, what
stood beside them does not.
"""

from __future__ import annotations

import pickle
import re
from collections import OrderedDict
from pathlib import Path
from typing import Any

ROUNDS = 500  # one for each foreign name; a file with more is no checkpoint
_UNKNOWN = re.compile(r"Unsupported global: GLOBAL ([\w.<>]+)")
_FILLED = re.compile(r"Can only (SETITEMS?|append|extend)\b.* but got <class '([\w.<>]+)'>")


class Placeholder:
    """Stands where an object of an unknown class stood: takes any arguments and state, and does nothing."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def __setstate__(self, _: object) -> None: ...


def foreign(value: object) -> str | None:
    """The full name of the class or function that stood where a placeholder, or its class, stands."""
    kind = value if isinstance(value, type) else type(value)
    return f"{kind.__module__}.{kind.__qualname__}" if issubclass(kind, Placeholder) else None


class _Mapping(Placeholder):
    """Of a class that derives from dict: its entries come one by one, into a plain one."""

    def __new__(cls, *_: object, **__: object) -> Any:
        return OrderedDict()


class _Sequence(Placeholder):
    """The same for lists."""

    def __new__(cls, *_: object, **__: object) -> Any:
        return []


def load_inert(path: Path, *, mapped: bool) -> object:
    """The content of a torch file, with placeholders for all that is neither tensor nor plain value.

    Modules of the operating system stay refused by torch whatever they are called for.

    Raises:
        pickle.UnpicklingError: the file holds something that even so cannot be read.
    """
    import torch

    kinds: dict[str, type[Placeholder]] = {}
    # torch refuses at the first unknown name, so that a round learns one.
    for _ in range(ROUNDS):
        stand_ins = [(_placeholder(name, kind), name) for name, kind in kinds.items()]
        try:
            with torch.serialization.safe_globals(stand_ins):  # type: ignore[arg-type] # they are callables
                return torch.load(path, map_location="cpu", weights_only=True, mmap=mapped)
        except pickle.UnpicklingError as error:
            if not _learnt(str(error), kinds):
                raise
    raise pickle.UnpicklingError(f"it names more than {ROUNDS} classes")


def _learnt(message: str, kinds: dict[str, type[Placeholder]]) -> bool:
    """Take in what torch's refusal says of one name; False where it is of another sort."""
    if unknown := _UNKNOWN.search(message):
        name = unknown.group(1)
        name = name if "." in name else f"builtins.{name}"  # torch's message leaves that away
        if name not in kinds:
            kinds[name] = Placeholder
            return True
    if filled := _FILLED.search(message):
        kind = _Mapping if filled.group(1).startswith("SETITEM") else _Sequence
        name = filled.group(2)
        if kinds.get(name) is Placeholder:
            kinds[name] = kind
            return True
    return False


def _placeholder(name: str, kind: type[Placeholder]) -> type[Placeholder]:
    module, _, qualname = name.rpartition(".")
    return type(qualname, (kind,), {"__module__": module, "__qualname__": qualname})
