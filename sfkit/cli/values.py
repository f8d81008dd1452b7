"""What was typed, as the values that commands take; typer would ask pydantic, whose import takes longer than
all that a usage error needs.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

_WANTED: dict[type[Any], str] = {str: "a text", Path: "a path", int: "a whole number", float: "a number"}


class Typed:
    """Reads texts, paths, numbers and choices, single or several; asks typer for everything else.

    Args:
        ask: typer's own way to read the parameter.
    """

    def __init__(self, ask: Callable[[], Any]) -> None:
        self._ask = ask

    def coerce(self, value: Any, *, param: Any, ctx: Any) -> Any:
        """The value as the command takes it.

        Raises:
            typer.BadParameter: it is not of the parameter's type, or less than its least.
        """
        info, annotation = param.type_descriptor.parameter_info, param.type_descriptor.annotation
        several = get_origin(annotation)
        kinds = get_args(annotation) if several in (list, tuple) else (annotation,)
        if value is None:
            return () if several in (list, tuple) else None
        # What typer has rules of its own for is left to it.
        ruled = info.parser or info.exists or info.resolve_path or info.clamp or info.max is not None
        if ruled or not all(_wanted(kind) for kind in kinds):
            return self._ask().coerce(value, param=param, ctx=ctx)
        try:
            if several is None:
                return _read(value, annotation, info.min)
            each = kinds if several is tuple else kinds * len(value)
            return several(_read(one, kind, info.min) for one, kind in zip(value, each, strict=True))
        except ValueError as error:
            raise typer.BadParameter(str(error), ctx=ctx, param=param) from error


def _wanted(kind: Any) -> str | None:
    """What a value of this type is called; None for types that are typer's business."""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return f"one of: {', '.join(str(choice.value) for choice in kind)}"
    return _WANTED.get(kind)


def _read(value: Any, kind: Callable[[Any], Any], least: float | None) -> Any:
    try:
        made = kind(value)
    except ValueError:
        made = None
    if made is None or (least is not None and not made >= least):  # nor is NaN
        bound = "" if least is None else f" of at least {least:g}"
        raise ValueError(f"found {value!r}, expected {_wanted(kind)}{bound}")
    return made
